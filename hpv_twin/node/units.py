"""SI values in the words of people: L/min, bar, kN beside m³/s, Pa, N."""
from __future__ import annotations

import math


def litres_per_minute(flow: float) -> str:
    """43.8 L/min, for m³/s."""
    return f'{flow * 6e4:.3g} L/min' if abs(flow) < 1e-5 else f'{flow * 6e4:.1f} L/min'


def both(name: str, value: float) -> str:
    """A setpoint's value in a person's unit and in SI: 43.8 L/min (0.00073 m³/s)."""
    if not math.isfinite(value):
        return str(value)
    if name == 'pump_flow':
        return f'{litres_per_minute(value)} ({value:.4g} m³/s)'
    if name == 'preload':
        return f'{value * 1e3:.4g} mm ({value:.4g} m)'
    return f'{value:.6g} {"Hz" if name == "frequency" else "N"}'


def preload_with_force(preload: float, stiffness: float) -> str:
    """5.20 mm (1.30 kN), for m and N/m."""
    return f'{preload * 1e3:.2f} mm ({preload * stiffness * 1e-3:.2f} kN)'


def gauge(pressure: float) -> str:
    """16.0 MPa gauge (160 bar), for Pa gauge."""
    return f'{pressure * 1e-6:.1f} MPa gauge ({pressure * 1e-5:.0f} bar)'


def megabytes(size: float) -> str:
    """1.3 MB or 2.1 GB, for bytes."""
    return f'{size * 1e-9:.1f} GB' if size >= 1e9 else f'{size * 1e-6:.1f} MB'
