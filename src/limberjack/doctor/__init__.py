"""Checks of this machine: drawing, speed, installed packages, and remedies for what fails.

    diagnosis = doctor.examine()
    print(diagnosis.core.works, diagnosis.threads.recommended)
    for backend in diagnosis.backends:
        print(backend.name, backend.works, backend.renderer or backend.why)

Each check that could crash or hang runs in a process of its own, with a time limit: an OpenGL
driver may end its process, and a MuJoCo with missing files does not import. Nothing is installed or
changed, and this process imports nothing heavy. `limberjack doctor` prints the result.
"""

from limberjack.doctor.examination import Backend, Check, Diagnosis, Threads, examine
from limberjack.doctor.packages import Extra

__all__ = ["Backend", "Check", "Diagnosis", "Extra", "Threads", "examine"]
