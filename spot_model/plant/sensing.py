"""What the simulated robots report: the true state after sensor and estimator effects, in order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from spot_model.effects.base import BodyEstimate, Draws, EstimateEffect, JointReading, Memory, SensorEffect
from spot_model.plant.memory import keeper, leaves, own_tensors, restarted, tensors_of, with_leaves
from spot_model.robot.rotation import AnyArray


class Sensing:
    """The sensor and estimator effects of a batch of simulations with their memories."""

    def __init__(
        self,
        sensors: Sequence[SensorEffect],
        estimators: Sequence[EstimateEffect],
        reading: JointReading,
        estimate: BodyEstimate,
    ) -> None:
        self._keep = keeper(reading.position_rad)
        self._sensors = tuple(effect.arrays_like(reading.position_rad) for effect in sensors)
        self._estimators = tuple(effect.arrays_like(reading.position_rad) for effect in estimators)
        self._sensor_memory: list[Memory] = [own_tensors(effect.start(reading)) for effect in self._sensors]
        self._estimator_memory: list[Memory] = [own_tensors(effect.start(estimate)) for effect in self._estimators]

    def read(self, truth: JointReading, dt_s: float, rng: Draws) -> JointReading:
        """What the joints report; moves the memories on by ``dt_s``."""
        for i, effect in enumerate(self._sensors):
            truth, memory = effect.read(truth, dt_s, self._sensor_memory[i], rng)
            self._sensor_memory[i] = self._keep(self._sensor_memory[i], memory)
        return truth

    def estimate(self, truth: BodyEstimate, joints: JointReading, dt_s: float, rng: Draws) -> BodyEstimate:
        """What the state estimator reports, given what the joints report; moves the memories on by ``dt_s``."""
        for i, effect in enumerate(self._estimators):
            truth, memory = effect.estimate(truth, joints, dt_s, self._estimator_memory[i], rng)
            self._estimator_memory[i] = self._keep(self._estimator_memory[i], memory)
        return truth

    def leaves(self) -> list[Any]:
        """On a GPU, the tensors of all memories."""
        return tensors_of((self._sensor_memory, self._estimator_memory))

    def reset(self, rows: AnyArray, reading: JointReading, estimate: BodyEstimate) -> None:
        """Start the memories afresh, from the truth, in the simulations of ``rows``, shape (n_sims,)."""
        for i, sensor in enumerate(self._sensors):
            memory = self._sensor_memory[i]
            self._sensor_memory[i] = self._keep(memory, restarted(rows, sensor.start(reading), memory))
        for i, estimator in enumerate(self._estimators):
            memory = self._estimator_memory[i]
            self._estimator_memory[i] = self._keep(memory, restarted(rows, estimator.start(estimate), memory))

    def snapshot(self) -> list[list[Any]]:
        """The memories as plain arrays and numbers, one list an effect."""
        return [leaves(memory) for memory in (*self._sensor_memory, *self._estimator_memory)]

    def restore(self, snapshot: list[list[Any]]) -> None:
        """Continue from a snapshot of the same effects.

        Raises:
            ValueError: It was made with other effects.
        """
        n_sensors = len(self._sensors)
        if len(snapshot) != n_sensors + len(self._estimators):
            raise ValueError(
                f"the snapshot is of {len(snapshot)} sensing effects, the plant has {n_sensors + len(self._estimators)}"
            )
        restored = [
            with_leaves(memory, values)
            for memory, values in zip((*self._sensor_memory, *self._estimator_memory), snapshot, strict=True)
        ]
        self._sensor_memory, self._estimator_memory = restored[:n_sensors], restored[n_sensors:]
