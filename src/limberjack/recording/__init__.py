"""Films and recordings of episodes.

    from limberjack import recording

    recording.record("humanoid", "walk", out="walk.mp4", policy="random")
    played = recording.record_episode(env, planner.act, {"domain": "humanoid", "task": "stand"})
    played.save(Path("episode.npz"))

A film shows an episode (`films.py`). A recording holds its actions, rewards, observations and
states (`episodes.py`), from which `replay` repeats it bit for bit. `solving.solve` records episodes
of the planner, one per core.
"""

from limberjack.recording.episodes import Recording, Transcript, record_episode, replay
from limberjack.recording.films import record

__all__ = ["Recording", "Transcript", "record", "record_episode", "replay"]
