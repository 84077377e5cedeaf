"""Single drives through motion files, safely, recorded and checked."""
