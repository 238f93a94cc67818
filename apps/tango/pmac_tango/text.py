"""Numbers as they come from Tango, and as the board reads and writes them."""

import math


def integer(value, what, least, most):
    """``value`` as an integer; ValueError where it is none from ``least`` to ``most``."""
    if not (least <= value <= most and value == int(value)):
        raise ValueError(f"{what} {value:g}: give an integer from {least} to {most}")
    return int(value)


def written(value):
    """``value`` as a command line has it, which knows no exponent and ten decimals."""
    if not math.isfinite(value):
        raise ValueError(f"{value}: the board takes finite numbers only")
    text = f"{value:.10f}".rstrip("0").rstrip(".")
    if not math.isclose(float(text), value, rel_tol=1e-6):
        raise ValueError(f"{value}: too small for the ten decimals that the board takes")
    return text


def read(text):
    """The number that a reply tells: ``12``, ``-0.5`` or ``$3501``."""
    digits = text.strip()
    return float(int(digits[1:], 16)) if digits.startswith("$") else float(digits)
