"""Topics, types and the CDR encoding of their messages, without ROS."""
