"""Models of ONNX in files as policies; needs the extra `onnx`.

    onnx.save("walker.onnx", policy)            # a network of `mlp`
    policy = onnx.load("walker.onnx")
    action = policy.actions(flat_observation)   # (..., observations) -> (..., actions), float32

A model of any other program becomes a policy with a card:

    card = mlp.Card(layout=(("angle", (2,)),), low=(-1.0,), high=(1.0,), sizes=(2, 1))
    content = onnx.carded(Path("mine.onnx").read_bytes(), card)

It has one input of float32 (N, observations), the flat observation in the order of the card's
layout, and one output of float32 (N, actions), for any N. Normalisation, activations and the end
are in the model; of the card, the layout, the bounds, to which actions are clipped, and the action
repeat are used. The card is that of a file of `mlp`: JSON under the name `limberjack` in the
model's metadata.

Loading a file runs no code: it is checked before the runtime sees it (see
`policies.onnx_models`), and each operator is one of the runtime's own. A model still computes as
much as its author wanted, which may take long.

No other file imports onnxruntime. It computes in one thread, so that equal rows give equal bits.
"""

import copy
import dataclasses
import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from limberjack.policies import mlp
from limberjack.policies.kinds import ROWS, PolicyError
from limberjack.utils.files import write_whole
from limberjack.utils.requirements import missing_extra

__all__ = [
    "ENDING",
    "OnnxPolicy",
    "carded",
    "check_installed",
    "content_of",
    "load",
    "parse",
    "save",
]

ENDING = ".onnx"  # of the files' names, by custom

_FATAL = 4  # the runtime's level of messages: nothing is written to standard error


def _runtime() -> Any:  # Any: the package has no types
    """The package onnxruntime; raises ImportError where it is missing."""
    try:
        import onnxruntime  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise missing_extra("onnx") from error
    return onnxruntime


def check_installed() -> None:
    """Raises ImportError, which names the packages to install, where one is missing."""
    importlib.import_module("limberjack.policies.onnx_models")
    _runtime()


class OnnxPolicy:
    """A model of ONNX with its card.

    Attributes:
      card: see the module's docstring.
    """

    def __init__(self, content: bytes) -> None:
        """Takes the content of a file.

        Raises:
          ValueError: it is no policy.
          ImportError: the runtime is missing.
        """
        from limberjack.policies import onnx_models

        self.card = mlp.Card.of_text(onnx_models.checked(content))
        self._least, self._most = mlp.float32_bounds(self.card)
        self._session = _session(content)
        self._input = self._checked_input()
        self._run(np.zeros((ROWS, self.card.num_observations), np.float32))

    def actions(self, observation: npt.ArrayLike) -> np.ndarray:
        """The actions at flat observations: (..., observations) -> (..., actions), float32.

        Raises:
          ValueError: the observation has another size.
          PolicyError: the model cannot compute them.
        """
        x = np.asarray(observation, np.float32)
        if x.shape[-1:] != (self.card.num_observations,):
            raise ValueError(
                f"observation has shape {x.shape}; expected (..., {self.card.num_observations})"
            )
        found = self._run(x.reshape(-1, x.shape[-1]))
        return np.clip(found, self._least, self._most).reshape(*x.shape[:-1], len(self.card.low))

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        """The actions, (N, actions), at observations of (N, ...) by name.

        Those that the card does not name are ignored.
        """
        return self.actions(mlp.flattened(self.card.layout, observations))

    def with_layout(self, layout: mlp.Layout) -> "OnnxPolicy":
        """The same model for an environment with these names of its observations."""
        other = copy.copy(self)
        other.card = dataclasses.replace(self.card, layout=layout)
        return other

    def _checked_input(self) -> str:
        """The name of the input; raises ValueError if the model has another form."""
        given, taken = self._session.get_outputs(), self._session.get_inputs()
        sizes = self.card.num_observations, len(self.card.low)
        for what, found, size in (("input", taken, sizes[0]), ("output", given, sizes[1])):
            forms = [(one.type, one.shape) for one in found]
            kind, shape = forms[0] if len(forms) == 1 else ("", [])
            is_open = len(shape) == 2 and not isinstance(shape[0], int)
            if kind != "tensor(float)" or not is_open or shape[1] != size:
                raise ValueError(
                    f"its {what}s are {str(forms)[:200]}; expected one of float32 (N, {size}), "
                    "whose first axis has a name in the place of a size"
                )
        return taken[0].name

    def _run(self, rows: np.ndarray) -> np.ndarray:
        """The numbers that the model returns for flat observations, (N, observations)."""
        try:
            (found,) = self._session.run(None, {self._input: rows})
        except Exception as error:  # of classes that the runtime does not publish
            raise PolicyError(f"the model cannot compute ({mlp.beginning(error)})") from error
        expected = len(rows), len(self.card.low)
        if found.shape != expected:
            raise PolicyError(f"the model returned shape {found.shape}; expected {expected}")
        return found


def carded(content: bytes, card: mlp.Card) -> bytes:
    """A model of another program with a card, as the content of a file.

    Args:
      content: of the model's file.
      card: see the module's docstring; without `sizes` it gets those of observations and actions.

    Raises:
      ValueError: the model has a card, or does more than a policy needs; or the card's entries do
        not fit each other.
    """
    from limberjack.policies import onnx_models

    sizes = card.sizes or (card.num_observations, len(card.low))
    made = onnx_models.with_card(content, dataclasses.replace(card, sizes=sizes))
    mlp.Card.of_text(onnx_models.checked(made))
    return made


def content_of(policy: mlp.Mlp) -> bytes:
    """The content of the file that `save` writes."""
    from limberjack.policies import onnx_models

    return onnx_models.with_card(onnx_models.model_of(policy), policy.card)


def save(path: Path | str, policy: mlp.Mlp) -> None:
    """Writes a network as a model, in the place of a file of that name.

    Equal networks give equal bytes.

    Args:
      path: of the file, which by custom ends in .onnx.
      policy: such as `mlp.load` returns.

    Raises:
      OSError: the file cannot be written.
    """
    write_whole(Path(path), content_of(policy))


def load(path: Path | str) -> OnnxPolicy:
    """The policy in a file.

    Raises:
      PolicyError: there is none; the message is one line and names the file.
      ImportError: the runtime is missing.
    """
    return parse(mlp.read(Path(path)), str(path))


def parse(content: bytes, title: str) -> OnnxPolicy:
    """The policy in the content of a file.

    Args:
      content: of the file.
      title: of the file, for messages.

    Raises:
      PolicyError: it is none.
      ImportError: the runtime is missing.
    """
    try:
        return OnnxPolicy(content)
    except ValueError as error:
        raise PolicyError(
            f"{title} cannot be played: {error}; expected a model with a card, as "
            "`limberjack export` and limberjack.policies.onnx.save write it"
        ) from error


def _session(content: bytes) -> Any:  # Any: the package has no types
    """The model in the runtime; raises ValueError if it is none."""
    runtime = _runtime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = _FATAL
    # Not the runtime's own format, which was not checked.
    options.add_session_config_entry("session.load_model_format", "ONNX")
    try:
        return runtime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"], enable_fallback=0
        )
    except Exception as error:  # of classes that the runtime does not publish
        raise ValueError(f"the runtime refuses it ({mlp.beginning(error)})") from error
