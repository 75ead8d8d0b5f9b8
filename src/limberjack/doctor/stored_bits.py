"""`StoredBits`: results of all tasks on other machines, in a small file of the package.

    stored = StoredBits.read()
    for run in stored.runs:  # one for each kind of processor, NumPy and MuJoCo
        print(run.kind, run.tasks["walker:walk"]["velocity"].checksums)

Each step of each reward and observation has a checksum of 16 bits, which notices every change of
one bit, and all but one in 65,536 of the other changes. A few steps have all their values, so that
a difference can be measured. Equal fields are stored once: many tasks of a domain observe the same,
and processors differ in some tasks only.

`tools/record_bits.py` writes the file.
"""

import base64
import binascii
import dataclasses
import json
import platform
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from limberjack.mujoco.fingerprint import versions
from limberjack.utils.files import write_whole

__all__ = ["FILE", "KEPT", "Field", "Kind", "Run", "StoredBits", "field_of"]

FILE = Path(__file__).with_name("stored_bits.json")

KEPT = (0, 1, 20, 60)  # steps whose values are stored; 0 is the start
# NumPy's names of the vector instructions whose sums and functions differ in their last bits, the
# widest first.
_VECTORS = {
    "AVX-512": ("X86_V4", "AVX512_SKX"),
    "AVX2": ("X86_V3", "AVX2"),
    "NEON": ("ASIMD", "NEON"),
}
_START = 0xFFFF  # of a checksum, so that zeros count


@dataclasses.dataclass(frozen=True)
class Kind:
    """Kind of a machine: the facts that decide the last bits of results.

    Attributes:
      system: such as 'Linux', 'Darwin' or 'Windows'.
      machine: such as 'x86_64' or 'arm64'.
      vectors: the widest instructions that NumPy uses here; '' if none of them is known.
      products: 'fused' if NumPy's library of linear algebra rounds a sum of products once per term,
        'rounded' if it rounds each product too.
      numpy: its version.
      mujoco: its version.
    """

    system: str
    machine: str
    vectors: str
    products: str
    numpy: str
    mujoco: str

    @classmethod
    def here(cls) -> "Kind":
        """The kind of this process."""
        found = np.show_config(mode="dicts")
        names = found.get("SIMD Extensions", {}) if found else {}
        known = {*names.get("baseline", ()), *names.get("found", ())}
        vectors = (name for name, needed in _VECTORS.items() if known.intersection(needed))
        packages = versions()
        return cls(
            platform.system(),
            platform.machine(),
            next(vectors, ""),
            "fused" if _fuses_products() else "rounded",
            packages["numpy"],
            packages["mujoco"],
        )

    def nearness(self, other: "Kind") -> tuple[bool, ...]:
        """A key that is the larger, the more of the other kind is the same."""
        names = ("mujoco", "machine", "system", "vectors", "products", "numpy")
        return tuple(getattr(self, name) == getattr(other, name) for name in names)

    def __str__(self) -> str:
        vectors = f" with {self.vectors}" if self.vectors else ""
        machine = f"{self.system} {self.machine}{vectors}, {self.products} products"
        return f"{machine}, NumPy {self.numpy}, MuJoCo {self.mujoco}"


@dataclasses.dataclass(frozen=True)
class Field:
    """A reward or an observation over the steps of all rows.

    Attributes:
      checksums: (steps,), uint16, each of all rows.
      values: (kept steps, rows times elements), float64.
    """

    checksums: np.ndarray
    values: np.ndarray


@dataclasses.dataclass(frozen=True)
class Run:
    """Results of one kind of machine: fields by name, by task such as 'walker:walk'."""

    kind: Kind
    tasks: Mapping[str, Mapping[str, Field]]


def _fuses_products() -> bool:
    """Whether `numpy.dot` adds a product to a sum before it rounds.

    (1 + e) (1 - e) - 1 is -e^2 then, and otherwise 0, because the product is rounded to 1. It shows
    for the second of two products only, so each comes second once.
    """
    e = 2.0**-30
    above, below = np.array([1, 1 + e]), np.array([-1, 1 - e])
    return bool(above.dot(below) or above[::-1].copy().dot(below[::-1].copy()))


def field_of(values: np.ndarray) -> Field:
    """The field of values of all steps, (steps, rows, ...)."""
    values = np.ascontiguousarray(values, "<f8").reshape(len(values), -1)
    checksums = [binascii.crc_hqx(step.tobytes(), _START) for step in values]
    return Field(np.array(checksums, "<u2"), values[[step for step in KEPT if step < len(values)]])


class StoredBits:
    """Runs, of which no two have the same kind."""

    def __init__(self, runs: Iterable[Run] = ()) -> None:
        """Holds the runs."""
        self.runs = tuple(runs)

    @classmethod
    def read(cls, path: Path = FILE) -> "StoredBits":
        """The runs of a file."""
        content = json.loads(path.read_text(encoding="utf-8"))
        arrays = [base64.b85decode(text) for text in content["arrays"]]

        def field(checksums: int, values: int) -> Field:
            kept = np.frombuffer(arrays[values], "<f8").reshape(len(KEPT), -1)
            return Field(np.frombuffer(arrays[checksums], "<u2"), kept)

        return cls(
            Run(
                Kind(**run["kind"]),
                {
                    task: {name: field(*numbers) for name, numbers in fields.items()}
                    for task, fields in run["tasks"].items()
                },
            )
            for run in content["runs"]
        )

    def with_run(self, run: Run) -> "StoredBits":
        """The same with another run, in the place of one of the same kind."""
        return StoredBits([*(one for one in self.runs if one.kind != run.kind), run])

    def write(self, path: Path = FILE) -> None:
        """Writes the runs to a file."""
        arrays: dict[bytes, int] = {}  # their numbers

        def numbers(field: Field) -> list[int]:
            contents = field.checksums.tobytes(), field.values.tobytes()
            return [arrays.setdefault(content, len(arrays)) for content in contents]

        runs = [
            {
                "kind": dataclasses.asdict(run.kind),
                "tasks": {
                    task: {name: numbers(field) for name, field in fields.items()}
                    for task, fields in run.tasks.items()
                },
            }
            for run in self.runs
        ]
        texts = [base64.b85encode(array).decode() for array in arrays]
        write_whole(path, json.dumps({"runs": runs, "arrays": texts}, indent=0) + "\n")
