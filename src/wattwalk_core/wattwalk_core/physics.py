"""Physical constants."""

from typing import Final

GRAVITY: Final = 9.81  # m/s²
