"""Running nodes on the page: measured power beside the model's, as it is published."""
