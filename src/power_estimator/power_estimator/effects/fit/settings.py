"""Settings of fits of effects."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FitSettings:
    """Settings of fits to prepared signals: blocks, folds, weights and searches."""

    block_seconds: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1)  # the longest of which enough fit in
    fewest_blocks: int = 15  # three for each fold
    least_used: float = 0.5  # of the rows of a block are resolved: most of it is seen
    folds: int = 5  # four fifths train each: a fit to them is nearly that to all
    piece: int = 10  # blocks that are tested together: several strides
    embargo: int = 1  # blocks left out on either side of these: a stride is like the next
    least_mse: float = 1e-4  # W²: errors below are alike; keeps the logarithm from rewarding luck
    drawn_together: int = 5  # blocks of a bootstrap: what is autocorrelated stays together
    bootstraps: int = 200  # five of them lie beyond either bound of 95 %
    tied: float = 0.9999  # cosine of two columns that a recording cannot tell apart
    reweightings: int = 2  # rounds of robust weights: two more move the power of a walk by 1 mW
    least_noise: float = 0.02  # W of a reference drive, so that priors weigh beside any meter
    at_bound: float = 1e-6  # of the larger bound: the tolerance of the solver and more
    settled: float = 0.1  # of the residual: exact, the power of a walk moves by 2 mW
    settled_bound: float = 0.05  # relative change of a discrepancy's bound, likewise
    near_delays: int = 3  # ms on either side of a known delay that are tried first
    fine_delay: float = 0.00025  # s between delays that are tried; 5 ms are 5 to 15 W of a gait
    screened_delays: int = 8  # that a screening tries within 1 ms: subsets differ by less
    screened_together: int = 3_000_000  # numbers of the normal matrices that are solved at once
    kept: int = 24_000_000  # bytes of columns and of designs that a fitter keeps
