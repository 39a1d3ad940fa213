import pytest


@pytest.fixture(scope="module")
def one_thread():
    """Runs the tests of a module in one thread of torch, whose sums then have one order."""
    torch = pytest.importorskip("torch")
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
