"""Stable-Baselines3: a batch as its `VecEnv`, and its saved models as policies.

    from limberjack import sb3
    from stable_baselines3 import PPO

    envs = sb3.make_vec_env("humanoid", "walk", num_envs=64, seed=0)
    PPO("MlpPolicy", envs).learn(1_000_000)

`VecEnv` says how rows, endings and infos appear. It needs the extra `sb3`.
"""

from limberjack.adapters.sb3 import SavedModel, SavedPolicy, VecEnv, make_vec_env

__all__ = ["SavedModel", "SavedPolicy", "VecEnv", "make_vec_env"]
