"""Power balance of recordings: electrical power over torque × speed, before any physics."""

from collections.abc import Mapping

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.quality.physics import ShaftBalance, power_balance


def power_balances(data: AlignedDataset) -> dict[str, ShaftBalance]:
    """Return the balance by drive; of `robot` alone where no drive has a meter of its own."""
    power, supply, torque, velocity = (
        each.astype(np.float64) for each in (data.power, data.supply, data.torque, data.velocity)
    )
    measured = data.measured_drives()
    if measured:
        columns = {name: data.names.index(name) for name in measured}
        found = {
            name: power_balance(power[:, column], torque[:, column], velocity[:, column])
            for name, column in columns.items()
        }
    else:
        found = {'robot': power_balance(supply, torque, velocity)}
    return {name: balance for name, balance in found.items() if balance is not None}


def balance_lines(data: AlignedDataset, balances: Mapping[str, ShaftBalance]) -> list[str]:
    """Return a line for each balance, with the unit where the current stands for torque."""
    current = set(data.current_as_torque)
    lines = []
    for name, balance in balances.items():
        text = str(balance)
        if name in current or (name == 'robot' and current):
            text = text.replace('W per W of torque', 'W per A·rad/s of current')
        lines.append(f'power balance of {name}: {text}')
    return lines


def balances_json(balances: Mapping[str, ShaftBalance]) -> dict[str, dict[str, float]]:
    """Return slope, error, share and R² by drive, for JSON."""
    fields = ('slope', 'error', 'share', 'r2')
    return {
        name: {field: float(np.round(getattr(balance, field), 6)) for field in fields}
        for name, balance in balances.items()
    }
