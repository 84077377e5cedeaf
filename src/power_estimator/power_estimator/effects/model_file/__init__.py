"""Effect models and their YAML files."""
