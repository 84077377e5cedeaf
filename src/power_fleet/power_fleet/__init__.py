"""Many recordings over time: changes of drives and meters."""
