"""Files that a training takes with it: they need torch and safetensors, not wattwalk."""
