"""A policy for simulations on a GPU: its network in torch where it is a plain one, on the host otherwise."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor

from spot_model.policy.observation import N_OBSERVATION, Sensed
from spot_model.policy.policy import Policy, observations
from spot_model.robot.state import Gains


class TorchPolicy:
    """What :class:`spot_model.policy.policy.Policy` does for many robots, on tensors of one device."""

    def __init__(self, policy: Policy, device: torch.device) -> None:
        self.policy, self.contract, self.width = policy, policy.contract, policy.width
        self._device = device
        self._order, self._back = (
            torch.as_tensor(order, device=device)
            for order in (policy.policy_from_canonical, policy.canonical_from_policy)
        )
        self._rest_rad = torch.as_tensor(policy.default_position_rad, dtype=torch.float32, device=device)

    @cached_property
    def _network(self) -> Callable[[Tensor], Tensor] | None:
        return network_of(self.policy, self._device)

    @property
    def _is_plain(self) -> bool:
        """Whether observation and set-point are a policy's own, and not those of a joint script."""
        return type(self.policy) is Policy

    def observe_many(self, sensed: Sensed, velocity_command: Tensor, last_action: Tensor) -> Tensor:
        """Observations of many robots, shape (n, 48), policy order."""
        if not self._is_plain:
            arrays = {name: _host(value) for name, value in vars(sensed).items()}
            found = self.policy.observe_many(Sensed(**arrays), _host(velocity_command), _host(last_action))
            return torch.as_tensor(found, device=self._device)
        seen: Tensor = observations(sensed, velocity_command, last_action, self._order, self._rest_rad)
        return seen

    def window(self, observation: Tensor, before: Tensor | None) -> Tensor:
        """The network's input: the last observations, the newest first, shape (n, width)."""
        if self.width == N_OBSERVATION:
            return observation
        if before is None:
            return observation.repeat(1, self.contract.observation_history)
        return torch.cat([observation, before[:, :-N_OBSERVATION]], dim=-1)

    def act(self, observation: Tensor) -> Tensor:
        """Run the network, shape (n, width) to (n, 12)."""
        if self._is_plain and self._network is not None:
            return self._network(observation.float())
        return torch.as_tensor(self.policy.act(_host(observation)), device=self._device)

    def setpoint_rad(self, action: Tensor) -> Tensor:
        """Joint position set-points of an action, canonical order, shape (n, 12), rad."""
        if not self._is_plain:
            return torch.as_tensor(self.policy.setpoint_rad(_host(action)), dtype=torch.float32, device=self._device)
        return (self.contract.action_scale_rad * action + self._rest_rad)[:, self._back]

    def gains(self) -> Gains:
        """The contract's gains, canonical order."""
        return self.policy.gains()


def network_of(policy: Policy, device: torch.device) -> Callable[[Tensor], Tensor] | None:
    """A policy file's network in torch; None where it has an operation that :data:`OPERATIONS` lacks.

    It is used only if it gives the file's stored action for the stored observation.
    """
    if not policy.file_bytes:
        return None
    import onnx
    from onnx import numpy_helper

    graph = onnx.load_from_string(policy.file_bytes).graph
    constants = {i.name: torch.tensor(numpy_helper.to_array(i), device=device) for i in graph.initializer}
    nodes = list(graph.node)
    if any(node.op_type not in OPERATIONS for node in nodes):
        return None
    source, sink = graph.input[0].name, graph.output[0].name
    attributes = [{a.name: onnx.helper.get_attribute_value(a) for a in node.attribute} for node in nodes]

    def run(observation: Tensor) -> Tensor:
        values: dict[str, Tensor] = {**constants, source: observation}
        for node, attribute in zip(nodes, attributes, strict=True):
            values[node.output[0]] = OPERATIONS[node.op_type](attribute, *(values[name] for name in node.input))
        return values[sink]

    pair = policy.contract.stored_pair
    action = run(torch.tensor([pair.observation], dtype=torch.float32, device=device))[0]
    error = float((action - torch.tensor(pair.action, dtype=torch.float32, device=device)).abs().max())
    return run if error <= pair.tolerance else None


def _gemm(attribute: dict[str, Any], a: Tensor, b: Tensor, c: Tensor | None = None) -> Tensor:
    a, b = (a.T if attribute.get("transA") else a), (b.T if attribute.get("transB") else b)
    product: Tensor = attribute.get("alpha", 1.0) * (a @ b)
    return product if c is None else product + attribute.get("beta", 1.0) * c


OPERATIONS: Final[dict[str, Callable[..., Tensor]]] = {
    "Gemm": _gemm,
    "MatMul": lambda _, a, b: a @ b,
    "Add": lambda _, a, b: a + b,
    "Sub": lambda _, a, b: a - b,
    "Mul": lambda _, a, b: a * b,
    "Div": lambda _, a, b: a / b,
    "Elu": lambda attribute, x: torch.nn.functional.elu(x, attribute.get("alpha", 1.0)),
    "Relu": lambda _, x: torch.relu(x),
    "Tanh": lambda _, x: torch.tanh(x),
    "Sigmoid": lambda _, x: torch.sigmoid(x),
    "Identity": lambda _, x: x,
}
"""ONNX operations of plain feed-forward networks, by name: attributes and inputs to the output."""


def _host(tensor: Tensor) -> np.ndarray[Any, np.dtype[Any]]:
    return np.asarray(tensor.detach().cpu())
