"""What every package needs: errors, commands, nodes, files, pages and plot style."""
