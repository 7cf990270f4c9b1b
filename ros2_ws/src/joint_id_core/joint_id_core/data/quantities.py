"""How quantities are written: values with their standard deviations, and units."""

from __future__ import annotations

import math

LEAST, MOST = 1e-3, 1e6  # of values that are written without an exponent


def unit_text(unit: str) -> str:
    """Return a unit as a reader wants it: nothing for a ratio, whose unit is "1"."""
    return "" if unit == "1" else unit


def with_unit(name: str, unit: str) -> str:
    """Return a name with its unit, such as "k_1 [Nm/rad]"."""
    return f"{name} [{text}]" if (text := unit_text(unit)) else name


def two_digits(size: float) -> str:
    """Return a number of two significant digits, such as "750" and "0.012"; with an exponent if it is far from 1."""
    text = f"{size:.2g}"
    return f"{float(text):.7g}" if abs(size) < MOST else text


def with_deviation(value: float, std_dev: float, unit: str = "") -> str:
    """Return a value to the second digit of its standard deviation, such as "3740 ± 750 Nm/rad".

    A value that is smaller than its standard deviation keeps two digits.
    """
    return f"{' ± '.join(_rounded(value, std_dev))} {unit_text(unit)}".rstrip()


def known_digits(value: float, std_dev: float) -> str:
    """Return a value alone as `with_deviation` writes it; to five digits if it has no standard deviation."""
    return _rounded(value, std_dev)[0] if math.isfinite(std_dev) and std_dev > 0.0 else f"{value:.5g}"


def _rounded(value: float, std_dev: float) -> tuple[str, str]:
    """Return a value and its standard deviation as text."""
    if not (math.isfinite(value) and math.isfinite(std_dev) and std_dev > 0.0):
        return f"{value:.4g}", f"{std_dev:.2g}"
    sigma = float(f"{std_dev:.1e}")
    first = _decade(value) if value else _decade(sigma)
    last = min(_decade(sigma), first) - 1  # decade of the last digit
    rounded = round(value, -last)
    if rounded and not LEAST <= abs(rounded) < MOST:
        return f"{value:.{first - last}e}", f"{std_dev:.2g}"
    spread = f"{sigma:.{max(0, 1 - _decade(sigma))}f}" if LEAST < 10.0 * sigma < MOST else f"{sigma:.1e}"
    return f"{rounded:.{max(0, -last)}f}", spread


def change_text(change: float, std_dev: float, unit: str = "") -> str:
    """Return a change with its sign, such as "+4.70 ± 0.42 %", as `with_deviation` does."""
    return f"{'+' if change > 0.0 else ''}{with_deviation(change, std_dev, unit)}"


def _decade(value: float) -> int:
    return math.floor(math.log10(abs(value)))
