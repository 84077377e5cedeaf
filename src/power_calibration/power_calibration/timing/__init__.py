"""How well the streams of a recording agree in time, and what it costs where they do not."""
