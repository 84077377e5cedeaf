"""Reading of recordings of any writer, complete or cut off."""
