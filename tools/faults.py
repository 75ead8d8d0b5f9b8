"""The faults that `plant_faults.py` plants: for each file, texts and what is to stand instead.

A good fault is a mistake that a reviewer could overlook: off by one, a wrong axis, a missing copy,
swapped arguments, a stale cache. To add one, copy enough of the source for the text to occur once.
"""

__all__ = ["FAULTS", "TESTS"]

# The tests of a part, where they are not simply its folder. The numbers of the suite are
# dm_control's, so that the tests beside it belong to them.
TESTS = {"suite": ["tests/suite", "tests/oracle/test_domains.py", "tests/oracle/test_episodes.py"]}

FAULTS: dict[str, list[tuple[str, str]]] = {
    "rl/batch.py": [
        ("            reward[begins] = 0.0\n", ""),
        ("            self._step_count[begins] = 0\n", ""),
        (
            "last = self._step_count >= self._step_limit",
            "last = self._step_count > self._step_limit",
        ),
        ("ends = ~np.isnan(termination) & ~last", "ends = ~np.isnan(termination)"),
        ("            if begins is not None:\n                ends &= ~begins\n", ""),
        ("np.asarray(termination)[ends]", "np.asarray(termination)[: ends.sum()]"),
        ("            discount[self.diverged] = 0.0\n", ""),
        ("            reward[self.diverged] = 0.0\n", ""),
        ("reward = np.array(reward, float)", "reward = np.asarray(reward, float)"),
        ("task._random = self._streams.own[row]", "task._random = self._streams.own[0]"),
        ("self._randomizer.draw(self._streams.beside[row])", "self._randomizer.draw(task._random)"),
        ("self._frames.forget(rows)", "self._frames.forget()"),
        (" & (self._step_count >= self._step_limit) & ~self.diverged", " & ~self.diverged"),
        ("return self._begins.copy()", "return self._begins"),
        ("np.where(self._step_count == 0, _FIRST, _MID)", "np.where(self._begins, _FIRST, _MID)"),
    ],
    "rl/streams.py": [
        ("        self.beside[row] = stream_beside(stream)\n", ""),
        ("in zip((self.own, self.beside), states", "in zip((self.beside, self.own), states"),
        ("        checked_seed(first + count - 1)\n", ""),
    ],
    "rl/randomize.py": [
        ("shape = nominal.shape[:1] + (1,) * (nominal.ndim - 1)", "shape = nominal.shape"),
        ("draw(random, nominal.copy())", "draw(random, nominal)"),
        ("not np.isfinite(values).all()", "not np.isfinite(values).any()"),
        (
            "np.append(np.asarray(key, np.uint32), np.uint32(position))",
            "np.asarray(key, np.uint32)",
        ),
        ("values.shape != nominal.shape or", "values.size != nominal.size or"),
    ],
    "rl/pixels.py": [
        ("self._stack[index][..., _COLOURS:]", "self._stack[index][..., :-_COLOURS]"),
        ("        stack[is_first] = np.tile(pictures[is_first], self.pixels.frame_stack)\n", ""),
        ("else self._stack.copy())", "else self._stack)"),
        ('"stack": self._stack[index].copy()', '"stack": self._stack[index]'),
        (
            '"height": self.height, "width": self.width',
            '"height": self.width, "width": self.height',
        ),
        ("np.flatnonzero(~self._is_seen)", "np.flatnonzero(self._is_seen)"),
        ('"camera_id": self.camera, "quality": self.quality}', '"camera_id": self.camera}'),
    ],
    "rl/observations.py": [
        (
            "return list(observation) if ordered else sorted(observation)",
            "return list(observation)",
        ),
        ("if not value.flags.owndata:", "if not value.flags.c_contiguous:"),
        (
            "specs.Array(value.shape, value.dtype, name=name)",
            "specs.Array(value.shape, float, name)",
        ),
    ],
    "rl/snapshot.py": [
        ("if len(self) != size:", "if len(self) < size:"),
        ("            if found != expected:", "            if type(found) is not type(expected):"),
    ],
    "rl/actions.py": [
        ('not in "fiub"', 'not in "fiubc"'),
        ("finite = np.isfinite(given)", "finite = ~np.isnan(given)"),
        ("return ~finite if", "return finite if"),
    ],
    "gym/transitions.py": [
        ("time_step.reward, last & ~truncated, truncated", "time_step.reward, last, truncated"),
        ("info = self._terms(~first) | self._drawn(first)", "info = self._terms(~first)"),
        ("self._terms(~first) |", "self._terms(first) |"),
        ('"final_info": self._terms(last)', '"final_info": self._terms(~last)'),
        ("{name: values.copy() for name, values in drawn.items()}", "dict(drawn)"),
        ("rows = rows & ~batch.diverged", "rows = rows.copy()"),
        ("(waiting + self.batch.first_row)", "waiting"),
        ("[seeds[row] for row in np.flatnonzero(begun).tolist()]", "seeds[: begun.sum()]"),
        ('{"diverged": batch.diverged.copy(), "_div', '{"diverged": last, "_div'),
    ],
    "gym/halves.py": [
        ("half, future = self._sent[0]", "half, future = self._sent[-1]"),
        ("list(dict.fromkeys(name for part in parts if part for name in part))", "list(given)"),
        ("shape = (size, *like.shape[1:])", "shape = like.shape"),
        ("        if self._process != os.getpid():  # forked", "        if False:  # forked"),
        ("np.full(shape, None) if like.dtype == object else ", ""),
    ],
    "gym/observations.py": [
        ("return list(observation[rows])", "return list(observation[: len(rows)])"),
        ("stop = start + math.prod(shape)", "stop = start + (shape[-1] if shape else 1)"),
        ("np.array(observation[part.name], self.dtype)", "np.asarray(observation[part.name])"),
        ("kept = {name: values[rows] for", "kept = {name: values[: len(rows)] for"),
        ("(spec.minimum, spec.maximum)", "(-1.0, 1.0)"),
    ],
    "gym/arguments.py": [
        ("return mask.copy()", "return mask"),
        ("        checked_seed(first + num_envs - 1)\n", ""),
        ("if not mask.any():", "if not mask.all():"),
    ],
    "utils/arrays.py": [
        ("np.sqrt(np.vecdot(x, x))", "np.sqrt((x * x).sum(axis=-1))"),
        (
            "np.matmul(vectors[..., None, :], frames[..., None, :, :])[..., 0, :]",
            "vectors @ frames",
        ),
        ("functools.reduce(np.minimum, values)", "functools.reduce(np.fmin, values)"),
        ("x.shape[0] == _batch_size.get()", "_batch_size.get() is not None"),
        ("_batch_size.reset(self._token)", "_batch_size.set(None)"),
    ],
    "utils/rewards.py": [
        ("if lower <= x <= upper:", "if lower < x < upper:"),
        (
            "in_bounds = np.logical_and(lower <= x, x <= upper)",
            "in_bounds = (lower < x) & (x < upper)",
        ),
        ("np.float_power(x, 2) if arrays.one_value_per_row(x) else x**2", "x * x"),
        ("axis=-1) / x.shape[-1]", "axis=-1) / x.shape[0]"),
        ("return np.fmax(x, 0.0)", "return np.maximum(x, 0.0)"),
        ("if lower > upper:", "if lower >= upper:"),
        ("return abs(x - lower if lower else x)", "return abs(x)"),
    ],
    "utils/containers.py": [
        ("for name in first if all(name in names", "for name in first if any(name in names"),
        ("if name in self._tasks and not self.allow", "if name in self._tags and not self.allow"),
    ],
    "utils/files.py": [("except BaseException as error:", "except Exception as error:")],
    "utils/xml_tools.py": [
        ("child: Any = copy.deepcopy(single)", "child: Any = copy.deepcopy(element)"),
        ("for element in top.iter(tag) if element is not top]", "for element in top.iter(tag)]"),
    ],
    "utils/png.py": [
        ("corner[1:] = left[:-1]", "corner[1:] = above[:-1]"),
        ("(to_left <= to_above) & (to_left <= to_corner)", "to_left <= to_above"),
    ],
    "evaluation/statistics.py": [
        ("np.mean(rewards[-LAST_STEPS:])", "np.mean(rewards[:LAST_STEPS])"),
        ("self.final_reward >= SUCCESS_REWARD", "self.final_reward > SUCCESS_REWARD"),
        ("tail = (1 - CONFIDENCE) / 2", "tail = 1 - CONFIDENCE"),
        ("resamples = min(at_once, RESAMPLES - first)", "resamples = at_once"),
        ("float(np.cumsum(rewards)[-1])", "float(np.sum(rewards))"),
        ("median=float(np.median(returns))", "median=float(np.sort(returns)[len(returns) // 2])"),
    ],
    "evaluation/store.py": [
        (
            "self.scores[policy].setdefault(score.seed, score)",
            "self.scores[policy][score.seed] = score",
        ),
        ('content[: content.rfind(b"\\n") + 1]', 'content[: content.rfind(b"\\n")]'),
        ("if not any(self.scores.values()):", "if True:"),
        ("left = left[self._file.write(left) :]", 'left = b"" if self._file.write(left) else left'),
        ("start=2):", "start=1):"),
    ],
    "evaluation/episodes.py": [
        ("        self._lengths[taking] = 0\n", ""),
        ("free = seed % ROWS not in places", "free = True"),
        ("so_far[1], so_far[0] + 1)", "so_far[1], so_far[0])"),
        ("self._waiting = passed + self._waiting[", "self._waiting = self._waiting["),
        ("        environment.reseed(seed)\n", ""),
    ],
    "suite/humanoid.py": [
        ("margin=_STAND_HEIGHT / 4", "margin=_STAND_HEIGHT / 2"),
        (
            "physics.center_of_mass_velocity()[..., :2]",
            "physics.center_of_mass_velocity()[..., ::2]",
        ),
        ('"left_foot", "right_hand", "right_foot"]', '"right_hand", "left_foot", "right_foot"]'),
        ("return (5 * move + 1) / 6", "return (5 * move + 1) / 5"),
        ("(4 + small_control) / 5", "(5 + small_control) / 6"),
        ("physics.control(), margin=1", "physics.control(), margin=2"),
    ],
    "suite/manipulator.py": [
        ("np.cos(angle / 2), np.sin(angle / 2)", "np.cos(angle), np.sin(angle)"),
        ('["grasp", ["xx", "zx"]]', '["grasp", ["xx", "xz"]]'),
        ('terms["grasping"] / 3', 'terms["grasping"] / 2'),
        ("[: 1 + self._insert]", "[:1]"),
        ("[0.1, 0.1, 1 - 0.1 - 0.1]", "[0.1, 0.2, 1 - 0.1 - 0.2]"),
        ("if place == physics.named", "if place is physics.named"),
    ],
    "suite/stacker.py": [
        ("self.random.randint(self._n_boxes)", "self.random.randint(1, self._n_boxes)"),
        ('for dimension in "xyz"]', 'for dimension in "xzy"]'),
        ("box_size = 2 * physics", "box_size = physics"),
        ("arrays.minimum_of(physics", "max(physics"),
    ],
    "suite/_planar_arm.py": [
        ('        qpos["finger"] = qpos["thumb"]\n', ""),
        (".xpos[names][..., ::2]", ".xpos[names][..., :2]"),
        (".xquat[names][..., ::2]", ".xquat[names][..., :2]"),
        ("np.where(is_limited, joints.jnt_range", "np.where(~is_limited, joints.jnt_range"),
        ("margin=_CLOSE * 2", "margin=_CLOSE"),
    ],
    "suite/utils/randomizers.py": [
        ("quaternion = stream.rand(4)", "quaternion = stream.randn(4)"),
        ("random_limited_quaternion(stream, upper)", "random_limited_quaternion(stream, lower)"),
        ("qpos[start + 3 : start + 7]", "qpos[start : start + 4]"),
        ("axis = random.randn(3)", "axis = random.rand(3)"),
    ],
    "mujoco/fields.py": [
        ('"key_qvel": "nv"', '"key_qvel": "nq"'),
        ('["xx", "xy", "xz", "yx", "yy", "yz", "zx"', '["xx", "yx", "zx", "xy", "yy", "zy", "xz"'),
        ('"numeric_data": "nnumericdata"', '"numeric_data": "nnumeric"'),
        (
            '("contype", "conaffinity", "condim", "priority")',
            '("contype", "conaffinity", "condim")',
        ),
        ("return any(name in inputs or", "return all(name in inputs or"),
        ("[: len(shape)]", "[:1]"),
    ],
    "mujoco/midphase.py": [
        ("if not 0 < len(planes) <= _FEW", "if not len(planes) <= _FEW"),
        ("model.geom_margin.any() or model.geom_gap.any()", "model.geom_margin.any()"),
        ("_collides(model) & (model.geom_bodyid == 0)", "_collides(model)"),
        ("            if (out > _ROUNDED).any():", "            if (out > _ROUNDED).all():"),
        ("not all(map(_is_harmless, own_fields))", "not any(map(_is_harmless, own_fields))"),
    ],
    "mujoco/math.py": [
        ("mj_quatprod(mj_quatneg(source), target)", "mj_quatprod(target, mj_quatneg(source))"),
        ("for degrees in (az, ay, ax)]", "for degrees in (ax, ay, az)]"),
    ],
    "mujoco/wrapper/data.py": [
        ("return velocity.reshape(2, 3)[::-1]", "return velocity.reshape(2, 3)"),
        ("if not 0 <= contact_id < self._data.ncon:", "if not 0 <= contact_id <= self._data.ncon:"),
        ('"_data", copy.copy(self._data)', '"_data", self._data'),
    ],
    "mujoco/wrapper/model.py": [
        ("opt.disableflags = before | bits", "opt.disableflags = bits"),
        ("self._shared or copy.copy(self._model)", "self._shared or self._model"),
        ("check_model._model is not last", "check_model is not last"),
    ],
    "mujoco/wrapper/visual.py": [
        ("            np.copyto(self.flags, before)\n", "            pass\n"),
        ("before = self.flags.copy()", "before = self.flags"),
        ("= False\n\n    @property", "= True\n\n    @property"),
    ],
    "planner/record.py": [
        (
            "np.array_equal(recorded, found, equal_nan=True)",
            "np.allclose(recorded, found, rtol=0, atol=1e-9, equal_nan=True)",
        ),
        ("_observed_otherwise(recording, step + 1,", "_observed_otherwise(recording, step,"),
        ("if last == (step + 1 == recorded):", "if not last or step + 1 == recorded:"),
    ],
}
