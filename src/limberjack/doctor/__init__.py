"""What works on this machine, and what to do about what does not.

    diagnosis = doctor.examine()
    print(diagnosis.core.works, diagnosis.threads.recommended)
    for backend in diagnosis.backends:
        print(backend.name, backend.works, backend.renderer or backend.why)

Whatever could crash or hang is tried in a process of its own, with a time limit: a driver of OpenGL
that ends its process, a MuJoCo whose files were overwritten. Nothing is installed or changed, and
this process imports nothing heavy. `limberjack doctor` prints it.
"""

from limberjack.doctor.examination import examine
from limberjack.doctor.findings import Backend, Check, Diagnosis, Extra, Threads

__all__ = ["Backend", "Check", "Diagnosis", "Extra", "Threads", "examine"]
