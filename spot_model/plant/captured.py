"""Work that is done again and again: on a GPU recorded once as a CUDA graph, and then repeated without the host."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from spot_model.errors import SpotRlError


class TorchDraws:
    """The draws that effects ask a source for (:class:`spot_model.effects.base.Draws`), as tensors of one device."""

    def __init__(self, seed: int, device: torch.device) -> None:
        self.generator = torch.Generator(device=device)
        self.generator.manual_seed(seed)
        self._device = device

    def random(self, size: tuple[int, ...]) -> Tensor:
        """Evenly drawn in [0, 1)."""
        return torch.rand(size, generator=self.generator, device=self._device)

    def standard_normal(self, size: tuple[int, ...]) -> Tensor:
        """Mean 0, standard deviation 1."""
        return torch.randn(size, generator=self.generator, device=self._device)

    def standard_exponential(self, size: tuple[int, ...]) -> Tensor:
        """Mean 1."""
        return torch.empty(size, device=self._device).exponential_(generator=self.generator)


class CaptureError(SpotRlError):
    """Work cannot be recorded, because it looks at values that are on the GPU."""


class Captured:
    """A function without arguments that changes tensors in place and returns the same ones each time.

    The first call runs it, so that kernels are loaded and constants are in place; the second records it as a CUDA
    graph. This and every later call replay the graph: the device works through it without waiting for Python, whose
    lines then no longer run.

    Args:
        work: What to repeat. Shapes and addresses of what it reads and writes never change.
        generators: What it draws from, besides the device's default generator.
        is_recorded: Whether to record; otherwise every call runs ``work``.
    """

    def __init__(self, work: Callable[[], Any], generators: Sequence[torch.Generator], *, is_recorded: bool) -> None:
        self._work = work
        self._generators = generators
        self._is_recorded = is_recorded
        self._is_warm = False
        self._graph: torch.cuda.CUDAGraph | None = None
        self._result: Any = None

    def __call__(self) -> Any:
        """Do the work; returns what it returns. Raises RecordingError: the work waits for the device."""
        if not self._is_recorded or not self._is_warm:
            self._is_warm = True
            return self._work()
        if self._graph is None:
            self._graph = self._record()
        self._graph.replay()
        return self._result

    def _record(self) -> torch.cuda.CUDAGraph:
        graph = torch.cuda.CUDAGraph()
        for generator in self._generators:
            graph.register_generator_state(generator)
        # A graph of another plant that the garbage collector frees while this one is recorded would void it.
        gc.collect()
        is_collecting = gc.isenabled()
        gc.disable()
        try:
            # Physics is recorded from the same stream, and its library calls what other modes forbid.
            with torch.cuda.graph(graph, stream=torch.cuda.current_stream(), capture_error_mode="thread_local"):
                self._result = self._work()
        except RuntimeError as error:
            raise CaptureError(
                f"work cannot be recorded as a CUDA graph: {error}. An effect or a reward of your own must not look at "
                "values (.item(), if, a mask as index); write it with torch.where; training goes without graphs with "
                "ppo.cuda_graphs=false"
            ) from error
        finally:
            if is_collecting:
                gc.enable()
        return graph
