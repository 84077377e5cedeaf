"""Attribution of model error to a missing physical effect."""
