import ctypes
import resource

import pytest
import torch

from trainer.memory import keep_freed_memory

PAGE_BYTES = resource.getpagesize()


def faults() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="a C library without mallopt")
def test_a_large_array_comes_back_without_page_faults() -> None:
    keep_freed_memory()
    source = torch.ones(12_500_000)
    pages = source.numel() * source.element_size() // PAGE_BYTES
    copy = source.clone()
    del copy
    before = faults()
    copy = source.clone()
    assert faults() - before < pages / 10
    assert torch.equal(copy, source)
