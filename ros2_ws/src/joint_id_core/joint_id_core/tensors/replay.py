"""The same operations again and again: on a GPU as a graph of CUDA, which starts all of them at once.

One sample of the filter is hundreds of small operations. On a GPU it takes longer to start each of them from Python
than to do them, unless the batch is very large.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable

from joint_id_core.tensors.torch_cell import torch


class Replay:
    """Runs work that reads and changes tensors in place; its arguments are copied to where its graph reads them."""

    def __init__(self, device: torch.device) -> None:
        self._on_gpu = device.type == "cuda"
        self._seen: set[Hashable] = set()
        self._graphs: dict[Hashable, tuple[torch.cuda.CUDAGraph, list[torch.Tensor]]] = {}

    def run(self, kind: Hashable, work: Callable[..., None], *arguments: torch.Tensor) -> None:
        """Do `work(*arguments)`. Work of one kind is the same operations on the same tensors, but for the arguments."""
        if not self._on_gpu or kind not in self._seen:  # before a capture it has to run once, for what is set up lazily
            self._seen.add(kind)
            work(*arguments)
            return
        if kind not in self._graphs:
            held, graph = [argument.clone() for argument in arguments], torch.cuda.CUDAGraph()
            with torch.cuda.graph(graph):  # records the operations, does not do them
                work(*held)
            self._graphs[kind] = graph, held
        graph, held = self._graphs[kind]
        for place, argument in zip(held, arguments, strict=True):
            place.copy_(argument)
        graph.replay()
