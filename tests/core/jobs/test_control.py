"""How many threads a process computes with."""

import pytest
import torch

from core.jobs.control import one_torch_thread


@pytest.mark.parametrize("before", [1, 3])
def test_one_thread_is_given_back_whatever_happens_meanwhile(before: int) -> None:
    mine = torch.get_num_threads()
    torch.set_num_threads(before)
    try:
        with one_torch_thread():
            assert torch.get_num_threads() == 1
        with pytest.raises(ZeroDivisionError), one_torch_thread():
            _ = 1 / 0
        assert torch.get_num_threads() == before
    finally:
        torch.set_num_threads(mine)
