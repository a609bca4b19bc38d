"""The commands and the support set as the tests of the commands have them."""

from cli.conftest import EXAMPLES, filled, five, home, invoke, store

__all__ = ["EXAMPLES", "filled", "five", "home", "invoke", "store"]
