"""How many examples a property test draws."""

import os

TIMES = int(os.environ.get("PROPERTY_TIMES", "1"))


def cases(usual: int = 100) -> int:
    """As usual; $PROPERTY_TIMES as many where it is set, as by `make nightly`."""
    return usual * TIMES
