"""Rows of a batch on a device as a `Snapshot`, and checks of saved states.

    snapshot = of_rows(batch, np.array([0, 3]))
    suite.load_batch("humanoid", "walk", 2).restore(snapshot)

A state is rounded to float32 on the device, so the CPU continues from it closely, not bit for bit.
"""

import dataclasses
from collections.abc import Mapping

import mujoco
import numpy as np

from limberjack.gpu import model_fields
from limberjack.gpu.batch import DeviceBatch
from limberjack.mujoco.simulation import STATE, without_calls
from limberjack.rl.randomize import stream_beside
from limberjack.rl.snapshot import Snapshot
from limberjack.utils.arrays import AnyArray

__all__ = ["check_state", "of_rows"]


def of_rows(batch: DeviceBatch, rows: np.ndarray) -> Snapshot:
    """The rows as a snapshot that batches and single environments of the same task restore.

    The next episode of a restored row is the first one of its seed.

    Args:
      batch: the batch, which has been reset.
      rows: sorted row numbers.
    """
    fields = batch.starts.of_rows(batch.read_rows().cpu().numpy()[rows])
    like = batch.starts.batch.snapshot([0])
    official = batch.environment.physics.model._model
    states = _states(official, fields, len(rows))
    readings = fields.get("sensordata", np.zeros((len(rows), official.nsensordata)))
    physics = without_calls({"state": states, "sensordata": readings})
    for name in like.physics.keys() - physics.keys():
        nominal = model_fields.values(official, name)
        is_nominal = fields[name] == nominal.astype(np.float32)  # else kept in double precision
        physics[name] = np.where(is_nominal, nominal, fields[name]).astype(nominal.dtype)
    streams = []
    for row in rows.tolist():
        own = np.random.RandomState(batch.seeds[row])
        pair = (own.get_state(), stream_beside(own).get_state())
        streams.append(pair[: len(like.streams[0])])
    return dataclasses.replace(
        like,
        physics={name: physics[name] for name in like.physics},
        step_count=batch.counter.steps.cpu().numpy()[rows].astype(int),
        begins=batch.counter.ended.cpu().numpy()[rows],
        streams=streams,
        registration=batch.environment.registration,
        name=batch.environment._name,
    )


def check_state(batch: DeviceBatch, state: Mapping[str, AnyArray]) -> None:
    """Raises ValueError unless a batch can continue from the result of its `state_dict`."""
    rows = state.get("rows")
    shape = None if rows is None else tuple(rows.shape)
    expected = (batch.num_envs, batch.starts.width)
    if shape != expected or state.get("parts") != batch.parts():
        raise ValueError(
            f"the state has rows of shape {shape}; expected {expected}, of the same task with the "
            "same number of environments; nothing was loaded"
        )


def _states(official: mujoco.MjModel, fields: Mapping[str, np.ndarray], count: int) -> np.ndarray:
    """Integration states, (n, nstate), of fields by name."""
    data = mujoco.MjData(official)
    states = np.empty((count, mujoco.mj_stateSize(official, STATE)))
    for row, state in enumerate(states):
        for name, values in fields.items():
            live = getattr(data, name, None)
            if name == "time":
                data.time = float(values[row])
            elif isinstance(live, np.ndarray):
                live[...] = values[row]
        mujoco.mj_getState(official, data, state, STATE)
    return states
