"""Settings by which models are judged."""

from dataclasses import dataclass, field

from power_estimator.effects.fit.settings import FitSettings


@dataclass(frozen=True)
class JudgeSettings:
    """Folds, rows that count, and what is taken out before a score."""

    fit: FitSettings = field(default_factory=FitSettings)  # folds and refits
    settling: float = 0.2  # s at the start of a stretch: networks begin with an empty memory
    iterations: int = 4  # of a refit: the linearisation no longer moves
    together: int = 4  # recordings refitted at once: each adds its own columns of meter errors
    spread: int = 6  # stretches whose R² gives its spread, as many as training has segments
    shortest: float = 10.0  # s of such a stretch: R² of a shorter one means little
    longest_lag: float = 0.05  # s by which a robot's supply may be read late
