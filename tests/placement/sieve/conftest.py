"""What every test of the sieve runs under: one thread, as those of the chain that it bounds."""

from tests.placement.tempered.conftest import one_thread

__all__ = ["one_thread"]
