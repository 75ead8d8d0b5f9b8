"""Plays, keeps, resumes, reads, replays and films episodes, for all commands.

    from limberjack import episodes, policies

    actor = policies.find("random", environment)
    batch = episodes.batch_for(environment, actor, range(100))
    for ended in episodes.play(batch, actor, range(100)):
        print([episode.total for episode in ended])

`episode.Episode` is the record of an episode, and `playing.play` the loop that plays them. Datasets
are `limberjack.data`.
"""

from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.playing import Step, batch_for, play, recorded
from limberjack.episodes.starts import Starts

__all__ = ["Episode", "Kept", "Starts", "Step", "batch_for", "play", "recorded"]
