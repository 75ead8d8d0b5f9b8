"""`Recorder`: the files of a run, in one directory.

    with Recorder(Path("out"), run) as recorder:
        recorder.begin(environment)
        run_episode(environment, policy, seed, on_step=recorder.add_step)
        recorder.write(run, episodes, fingerprint)
    print(recorder.written, recorder.left_out)

A film or plot that cannot be made is left out, with the reason; the run continues without it. The
page is always written: it needs nothing but Python. One recorder at a time writes to a directory,
and never over the results of another task or policy.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from limberjack.mujoco.camera import RenderingError
from limberjack.rl.control import Environment
from limberjack.see.report.curve import write_return_plot
from limberjack.see.report.page import write_page
from limberjack.see.report.result import FILM as _FILM
from limberjack.see.report.result import PAGE as _PAGE
from limberjack.see.report.result import PLOT as _PLOT
from limberjack.see.report.result import RESULT as _RESULT
from limberjack.see.report.result import Played, Result, as_result, check_folder, write_result
from limberjack.see.report.trace import Step, Trace
from limberjack.see.video import Film, Rendered, first_camera
from limberjack.utils.facts import title_of
from limberjack.utils.files import Hold, Partial

__all__ = ["Recorder"]


class Recorder:
    """Writes a run's files into a directory, which it makes."""

    def __init__(
        self,
        directory: Path,
        run: Mapping[str, object],
        command: str = "",
    ) -> None:
        """Make the directory, and keep other processes from writing there until `close`.

        Args:
          directory: results of an earlier run of the same task and policy are replaced.
          run: the facts of the run; has 'policy', and 'domain' and 'task', or 'environment'.
          command: the command line as it was typed, for the page; empty if there was none.

        Raises:
          ValueError: another process writes there, or it holds other results.
          OSError: it cannot be made or written to.
        """
        directory.mkdir(parents=True, exist_ok=True)
        self._hold = Hold(directory)
        try:
            check_folder(directory, run)
            Partial(directory / _RESULT).discard()  # fails now, not after the last episode
        except BaseException:
            self._hold.release()
            raise
        self.written: list[Path] = []
        self._directory = directory.absolute()  # a policy may change the working directory
        self._command = command
        self._reasons: dict[str, list[str]] = {}  # names of the files left out, by the reason
        self._film: Film | None = None
        self._trace: Trace | None = None
        self._physics: Rendered | None = None

    def close(self) -> None:
        """Remove an unfinished film, and let other processes write to the directory."""
        self.drop_film()
        self._hold.release()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def left_out(self) -> list[str]:
        """One line for each reason for leaving out files."""
        return [f"no {' and no '.join(names)}: {why}" for why, names in self._reasons.items()]

    def begin(self, environment: Environment) -> None:
        """Film and trace the environment's episode from its present state on."""
        self._physics = environment.physics
        self._trace = Trace(environment)
        try:
            camera = first_camera(environment.physics.model)
            self._film = Film(self._directory / _FILM, environment.control_timestep(), camera)
        except ImportError as error:
            self._leave_out(_FILM, error)

    def add_step(self, step: Step) -> None:
        """Trace and film the reset or step that the environment has just returned."""
        if self._trace is not None:
            self._trace.add(step)
        if self._film is None or self._physics is None:
            return
        try:
            self._film.add(self._physics)
        except (RenderingError, OSError) as error:
            self._leave_out(_FILM, error)
            self.drop_film()

    def add_plan(self, stage: str, terms: Mapping[str, float]) -> None:
        """Trace the plan that the next step's action is from; see `Trace.add_plan`."""
        if self._trace is not None:
            self._trace.add_plan(stage, terms)

    def drop_film(self) -> None:
        """Remove the film, if it is not in its place."""
        film, self._film = self._film, None
        if film is not None:
            film.discard()

    def drop_episode(self) -> None:
        """Remove the film and the trace of an episode that was not shown to its end."""
        self.drop_film()
        self._trace = None

    def write(
        self, run: Mapping[str, object], episodes: Sequence[Played], model_fingerprint: str
    ) -> None:
        """Write result.json, return.png, video.mp4 and report.html, and no files of earlier runs.

        Args:
          run: the facts of the run; has 'domain', 'task', 'policy' and 'control_timestep'.
          episodes: those that ended; without any there is neither plot nor page.
          model_fingerprint: see `fingerprint`.

        Raises:
          OSError: a file cannot be written.
        """
        result = as_result(run, episodes, model_fingerprint)
        write_result(self._directory / _RESULT, result)
        self.written.append(self._directory / _RESULT)
        for name in (_PLOT, _FILM, _PAGE):  # of an earlier run
            (self._directory / name).unlink(missing_ok=True)
        if episodes:
            self._write_plot(result, episodes)
        self._write_film()
        if episodes:
            self._write_page(result, episodes)

    def _write_plot(self, result: Result, episodes: Sequence[Played]) -> None:
        title = f"{title_of(result)}, policy {result['policy']}"
        path = self._directory / _PLOT
        try:
            write_return_plot(path, title, episodes, result["control_timestep"])
        except ImportError as error:
            self._leave_out(_PLOT, error)
        else:
            self.written.append(path)

    def _write_film(self) -> None:
        if self._film is not None:
            try:
                self._film.finish()
                self.written.append(self._directory / _FILM)
            except OSError as error:
                self._leave_out(_FILM, error)
        self.drop_film()

    def _write_page(self, result: Result, episodes: Sequence[Played]) -> None:
        if self._trace is None:
            return
        film, path = self._directory / _FILM, self._directory / _PAGE
        reasons = " and ".join(why for why, names in self._reasons.items() if _FILM in names)
        shown = film if film in self.written else None
        write_page(path, result, episodes, self._trace, shown, reasons, self._command)
        self.written.append(path)

    def _leave_out(self, name: str, why: Exception) -> None:
        reason = " ".join(str(why).split())  # on one line
        self._reasons.setdefault(reason, []).append(name)
