"""The folder of public logs that WATTWALK_REAL_DATA names, and the map of one of them."""

import os
from pathlib import Path

_BESIDE = Path(__file__).resolve().parents[3] / 'shared' / 'real_data'
REAL = Path(os.environ.get('WATTWALK_REAL_DATA') or _BESIDE)

HOPPER = """
format: import/1
time: {column: motor_data.time, unit: s}
drives:
  'MOTOR_*':
    position: {from: motor_data.motor_pos.*, unit: rev}
    velocity: {from: motor_data.motor_vel.*, unit: rev/s}
    torque: {from: motor_data.motor_qcurrent.*, scale: 0.02506, from_unit: A, at: motor}
    command: {from: motor_data.motor_pos_cmd.*, unit: rev}
    voltage: {from: motor_data.bus_voltage.*, unit: V}
    current: {from: motor_data.bus_current.*, unit: A, positive: drawn}
    temperature: {from: motor_data.motor_temp.*, unit: degC}
card: {robot: hopper}
"""
