"""The faults planted by `plant_faults.py`: for each file, pairs of a source text and a wrong text.

A good fault is a mistake that a reviewer could overlook: an off-by-one error, a wrong axis, a
missing copy, swapped arguments, a stale cache. To add one, quote enough of the source for the text
to occur exactly once.
"""

__all__ = ["FAULTS", "TESTS"]

# The tests of a part, unless they are just its folder. The suite's numbers are compared with
# dm_control's, so those tests belong to it.
TESTS = {"suite": ["tests/suite", "tests/oracle/test_domains.py", "tests/oracle/test_episodes.py"]}

FAULTS: dict[str, list[tuple[str, str]]] = {
    "rl/batch.py": [
        ("task._random = self._streams.own[row]", "task._random = self._streams.own[0]"),
        ("self._randomizer.draw(self._streams.beside[row])", "self._randomizer.draw(task._random)"),
        (
            "            self._frames.forget(rows)\n        self._c",
            "            self._frames.forget()\n        self._c",
        ),
        ("return self._begins.copy()", "return self._begins"),
        (
            "a start\n            self._begin(np.flatnonzero(begins))\n",
            "a start\n            self._begin(running)\n",
        ),
        (
            "self._replicas.simulation.save(rows, self._s",
            "self._replicas.simulation.save(None, self._s",
        ),
        ("            self._begins[rows] = True  # until c", "            pass  # until c"),
        (
            "self._streams.begin([row], self._task, self._replicas.simulation)",
            "",
        ),
        ("self._streams.replace(row, stream, seeds[i])", "self._streams.own[row] = stream"),
    ],
    "rl/endings.py": [
        ("            reward[begins] = 0.0\n", ""),
        ("            self.steps[begins] = 0\n", ""),
        ("            last &= ~begins\n", ""),
        ("            step_type[begins] = _FIRST\n", ""),
        ("return self.steps >= self.step_limit", "return self.steps > self.step_limit"),
        ("ends = ~np.isnan(termination) & ~last", "ends = ~np.isnan(termination)"),
        ("            if begins is not None:\n                ends &= ~begins\n", ""),
        ("np.asarray(termination)[ends]", "np.asarray(termination)[: ends.sum()]"),
        ("            discount[diverged] = 0.0\n", ""),
        ("            reward[diverged] = 0.0\n", ""),
        ("            last |= diverged\n", ""),
        ("reward = np.array(reward, float)", "reward = np.asarray(reward, float)"),
        ("np.where(self.steps == 0, _FIRST, _MID)", "np.where(self.steps <= 1, _FIRST, _MID)"),
        ("self._all_one.copy(), self._all_mid.copy()", "self._all_one, self._all_mid.copy()"),
    ],
    "rl/stream_fields.py": [
        ("simulation.set_fields(fields, row)", "simulation.set_fields(fields)"),
        ("np.random.RandomState(0)", "task._random"),
    ],
    "rl/streams.py": [
        (
            "                self.beside[row] = stream_beside(self.own[row])\n",
            "                pass\n",
        ),
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
            "specs.Array(np.shape(value), np.asarray(value).dtype, name=name)",
            "specs.Array(np.shape(value), float, name)",
        ),
    ],
    "rl/snapshot.py": [
        ("if len(self) != size:", "if len(self) < size:"),
        ("elif found != expected and not", "elif type(found) is not type(expected) and not"),
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
    "rl/represented.py": [
        ("if waits and not step else", "if waits else"),
        ("stream is getattr(task", "stream is not getattr(task"),
        ("known == list(range(known[0], known[0] + len(known)))", "known"),
    ],
    "report/chart.py": [
        ("heights[number + 1 :] if", "heights if"),
        ("_DASH * len(above)\n", "0.0\n"),
        ("is_alone = ~touches", "is_alone = touches"),
        ("left=np.nan, right=np.nan", ""),
        ("(at if line.at is None else line.at) / until", "at / until"),
    ],
    "report/labels.py": [
        ("        stream.set_state(state)\n", "        pass\n"),
        ("(found[name], derived, strict=True)", "(derived, derived, strict=True)"),
        ("sorted(of_number - shared)", "sorted(of_number)"),
        ("            array[...] = self._base[name]\n", "            pass\n"),
        ("is_vector else", "not is_vector else"),
    ],
    "report/units.py": [
        ("gain * gear:g", "gain:g"),
        ("gear != 1 or", ""),
        ("[joint == _Joint.mjJNT_HINGE]", "[joint != _Joint.mjJNT_HINGE]"),
    ],
    "gym/observations.py": [
        ("np.where(least < low,", "np.where(least > low,"),
        ("np.where(most > high,", "np.where(most < high,"),
        ("return list(observation[rows])", "return list(observation[: len(rows)])"),
        ("stop = start + math.prod(shape)", "stop = start + (shape[-1] if shape else 1)"),
        ("np.array(observation[part.name], self.dtype)", "np.asarray(observation[part.name])"),
        ("kept = {name: values[rows] for", "kept = {name: values[: len(rows)] for"),
        ("low, high = open_bounds(spec)", "low, high = spec.minimum, spec.maximum"),
    ],
    "gym/arguments.py": [
        ("return mask.copy()", "return mask"),
        ("        checked_seed(first + num_envs - 1)\n", ""),
        ("if not mask.any():", "if not mask.all():"),
    ],
    "utils/arrays.py": [
        ("else np.vecdot(x, x)", "else (x * x).sum(axis=-1)"),
        (
            "np.matmul(vectors[..., None, :], frames)[..., 0, :]",
            'np.einsum("...i,...ij->...j", vectors, frames)',
        ),
        ("functools.reduce(np.minimum, values)", "functools.reduce(np.fmin, values)"),
        (
            'return getattr(x, "shape", None) == (_batch_size.get(),)',
            "return _batch_size.get() is not None",
        ),
        ("_batch_size.reset(self._token)", "_batch_size.set(None)"),
    ],
    "utils/rewards.py": [
        ("if lower <= x <= upper:", "if lower < x < upper:"),
        ("return 1 / (_square(x * scale) + 1)", "return 1 / (x * scale * x * scale + 1)"),
        ("np.where(has_margin, outside, 0.0))", "outside)"),
        ("np.float_power(x, 2) if arrays.one_value_per_row(x) else x**2", "x * x"),
        ("axis=-1) / x.shape[-1]", "axis=-1) / x.shape[0]"),
        ("return np.fmax(x, 0.0)", "return np.maximum(x, 0.0)"),
        ("(lower > upper, ", "(lower >= upper, "),
        ("return abs(x - lower if lower else x)", "return abs(x)"),
    ],
    "utils/containers.py": [
        ("for name in first if all(name in names", "for name in first if any(name in names"),
        ("if name in self._tasks and not self.allow", "if name in self._tags and not self.allow"),
    ],
    "utils/files.py": [("except BaseException as error:", "except Exception as error:")],
    "utils/xml_tools.py": [
        ("child: _Node = copy.deepcopy(single)", "child: _Node = copy.deepcopy(element)"),
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
        ('complete = content[: content.rfind(b"\\n") + 1]', "complete = content"),
        ("if not any(self.scores.values()):", "if True:"),
        ("left = left[self._file.write(left) :]", 'left = b"" if self._file.write(left) else left'),
        ("start=2):", "start=1):"),
    ],
    "workers/identity.py": [
        ('str(version).split(".")[:2]', 'str(version).split(".")[:1]'),
    ],
    "doctor/packages.py": [
        ('if file.suffix != ".pyc" and not', "if not"),
        ("if len(set(installed.values())) > 1:", "if len(set(installed.values())) > 2:"),
        ('package.partition("[")[0]', "package"),
    ],
    "evaluation/episodes.py": [
        ("        self._lengths[taking] = 0\n", ""),
        ("is_free = seed % ROWS not in occupied", "is_free = True"),
        ("so_far[1], so_far[0] + 1)", "so_far[1], so_far[0])"),
        ("self._waiting = skipped + self._waiting[", "self._waiting = self._waiting["),
        ("        environment.reseed(seed)\n", ""),
    ],
    "suite/_chain.py": [
        ("                end = link\n", ""),
        ("next=i + 1", "next=i - 1"),
    ],
    "suite/cartpole.py": [
        (".prod(axis=-1)", ".max(axis=-1)"),
        ("margin=_FAST).min(axis=-1)", "margin=_FAST).mean(axis=-1)"),
        ("1 - n_poles - 0.05", "-0.05"),
    ],
    "suite/lqr.py": [
        ('root.iterfind("worldbody//joint")', 'root.iter("joint")'),
        ("np.where(is_over, 0.0, np.nan)", "np.where(is_over, 0.0, 1.0)"),
        ("np.sqrt(2) * unit", "unit"),
    ],
    "suite/lqr_solver.py": [
        ("a + b @ k", "a - b @ k"),
        ("timestep * change + drift", "change + drift"),
    ],
    "suite/swimmer.py": [
        ("_PLANAR = [0, 1, 5]", "_PLANAR = [0, 1, 2]"),
        ("margin=5 * radius", "margin=radius"),
        ("limit=360.0 / links", "limit=180.0 / links"),
    ],
    "suite/humanoid.py": [
        ("margin=_STAND_HEIGHT / 4", "margin=_STAND_HEIGHT / 2"),
        (
            "physics.center_of_mass_velocity()[..., :2]",
            "physics.center_of_mass_velocity()[..., ::2]",
        ),
        ('"left_foot", "right_hand", "right_foot"]', '"right_hand", "left_foot", "right_foot"]'),
        ("return (5 * move + 1) / 6", "return (5 * move + 1) / 5"),
    ],
    "suite/_locomotion.py": [
        ("margin=1 + at_least", "margin=at_least"),
        ("margin=at_least if margin is None else margin", "margin=at_least"),
        ("(4 + mean) / 5", "(5 + mean) / 6"),
        ("control, margin=1", "control, margin=2"),
    ],
    "suite/manipulator.py": [
        ("np.cos(angle / 2), np.sin(angle / 2)", "np.cos(angle), np.sin(angle)"),
        ('["grasp", ["xx", "zx"]]', '["grasp", ["xx", "xz"]]'),
        ('terms["grasping"] / 3', 'terms["grasping"] / 2'),
        ("[: 1 + self._insert]", "[:1]"),
        ("_P_IN_HAND, _P_IN_TARGET = 0.1, 0.1", "_P_IN_HAND, _P_IN_TARGET = 0.1, 0.2"),
        ("if position == physics.named", "if position is physics.named"),
    ],
    "suite/stacker.py": [
        ("self.random.randint(self._n_boxes)", "self.random.randint(1, self._n_boxes)"),
        ('for axis in "xyz"]', 'for axis in "xzy"]'),
        ("box_size = 2 * physics", "box_size = physics"),
        ("arrays.minimum_of(to_target)", "max(to_target)"),
    ],
    "suite/quadruped.py": [
        ('arrays.to_frame(data.xpos["torso"]', 'arrays.to_frame(-data.xpos["torso"]'),
        ("readings == _NO_INTERSECTION, 1.0", "readings == _NO_INTERSECTION, 0.0"),
        ("ball[..., :3] - root[..., :3], ball[..., 3:]", "ball[..., :3], ball[..., 3:]"),
        ("    physics.simulation.reset()\n", ""),
        ("        pose[2] += _RISE\n", "        pose[2] = pose[2] + 2 * _RISE\n"),
        ("_BALL_SPEED * self.random.randn(2)", "_BALL_SPEED * self.random.rand(2)"),
        ("_upright_reward(physics, _ESCAPE_TILT)", "_upright_reward(physics)"),
        ('(0.5 + 0.5 * terms["fetch"])', 'terms["fetch"]'),
    ],
    "suite/_zoom.py": [
        ("np.arange(size) * ((count - 1) / (size - 1))", "np.arange(size) * (count / size)"),
        ("    c[0] /= 1 - z_far * z_far\n", ""),
        ("count - 1 - abs(count - 1 - knots)", "np.minimum(knots, count - 1)"),
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
    "mujoco/lazy_batch.py": [
        ('self._fields.write("sensor_needstage", self._disabled, _NEVER)', "pass"),
        ("            self.before_call[rows] = self.state[rows]\n", ""),
        ("            self.last_call[rows] = kind\n", ""),
        ("batch.step(rows, kind, _UP_TO_VELOCITY)", "batch.step(rows, kind)"),
        ("for live in (self.state, self.warning)]", "for live in (self.state,)]"),
        ("        np.copyto(self.state, self.before_call)\n", ""),
        ("            self._set_readings(loaded, readings[loaded])\n", "            pass\n"),
        ("        if name in _OF_SENSORS:\n", "        if name == _READINGS:\n"),
        ("read &= self._disabled\n", "read = self._disabled.copy()\n"),
        ("        if self._was_called:\n            self._replay()\n\n", "\n"),
        ("is_good = ~is_bad_state(self._model, state[~is_reached])", "is_good = left >= 0"),
        ("        np.copyto(self.warning, counted)\n", ""),
        ("return can_be & same.all(axis=-1)", "return can_be"),
        ("if sets_constants:\n            new", "if False:\n            new"),
        ("        new._replay()\n", ""),
        ("if model.nplugin or remembered or _any_callback():", "if model.nplugin or remembered:"),
        ("late & np.isin(model.sensor_type, _WITHOUT_EFFECT)", "late"),
    ],
    "mujoco/row_fields.py": [
        ("            flags |= ACTUATION\n", ""),
        ("            flags[...] = before\n", "            pass\n"),
        ("                option.disableflags |= ACTUATION\n", "                pass\n"),
        ("                option.disableflags = flags\n", "                pass\n"),
        ("            mujoco.mj_setConst(model, self._data)\n", "            pass\n"),
        ("            self._array[rows] = values\n", "            pass\n"),
        ("return values if numbers.ndim else values[None]", "return values"),
    ],
    "mujoco/batch_simulation.py": [
        ("self._call(-_at_least_one(nstep), rows)", "self._call(_at_least_one(nstep), rows)"),
        ("self._call(START, rows)", "self._call(FORWARD, rows)"),
        ("key = -1 if keyframe is None else keyframe", "key = -1"),
        (
            "mujoco.mj_extractState(model, whole, STATE, part, signature)",
            "part[:] = whole[: part.size]",
        ),
        ("self.set_constants(None if row is None else np.array([row]))", "pass"),
        ("        self.set_constants(rows)\n", ""),
        ("            lazy.forget_calls()\n", "            pass\n"),
        ("ReadOnly.of(field, _COMMON.format(name)) if is_array else field, False", "field, False"),
        ("            forget()\n", "            pass\n"),
    ],
    "mujoco/single_simulation.py": [
        (
            "            mujoco.mj_step(model, data, nstep - 1)\n",
            "            mujoco.mj_step(model, data, nstep)\n",
        ),
        ("if self._opt.integrator == _RUNGE_KUTTA:", "if False:"),
        ("        self._remember(-nstep)\n", "        self._remember(nstep)\n"),
        ("            opt.disableflags = self._flags_before | ACTUATION\n", ""),
        ("            self._data.sensordata[...] = saved[", "            _ = saved["),
        ("self.warnings[...] = 0 if earlier is None else earlier", "self.warnings[...] = 0"),
        ("== state.tobytes()", "!= b''"),
        (
            "            mujoco.mj_step1(self._model(), self._data)  # the",
            "            pass  # the",
        ),
        (
            "(data, self.sets_constants, self._call, self._before.copy())",
            "(data, self.sets_constants, self._call, self._before)",
        ),
        ("        _check(data.model._model, self.get_state(STATE))\n", ""),
        ("            model.opt.disableflags = self._flags_before\n", ""),
    ],
    "mujoco/replicas.py": [
        ("        one.__dict__.update(like._attributes())\n", ""),
        ("one.simulation.sets_constants = like", "one.simulation.sets_constants = False and like"),
        (
            "            values[row] = read_field(model, name)\n",
            "            values[0] = read_field(model, name)\n",
        ),
        ("        simulation.warnings[...] = 0\n", ""),
        (
            "self.shown(row).render(**kwargs)\n        return",
            "self.shown(numbers[0]).render(**kwargs)\n        return",
        ),
        ("        self._take_fields(self.textured, row)\n", ""),
        ("        self._take_fields(one, row)\n", ""),
    ],
    "mujoco/rows_view.py": [
        (
            '        if callable(field):\n            raise AttributeError(f"a batch has no data',
            '        if False:\n            raise AttributeError(f"a batch has no data',
        ),
        ("return copy.copy(self._model)", "return self._model"),
        (
            "            vars(self)[name] = field  # c",
            "            vars(self)[name] = field.copy()  # c",
        ),
        ("return ReadOnlyStruct(field, name, self._own_parts(name))", "return field"),
    ],
    "mujoco/read_only.py": [
        ("        self._refuse_writing()\n        super()", "        super()"),
        ("                out._refuse_writing()\n", "                pass\n"),
        ('self._advice = getattr(source, "_advice", "")', 'self._advice = ""'),
    ],
    "mujoco/model_values.py": [
        ("        if name in leave_out:\n            continue\n", ""),
        ("for name in before.keys() | after.keys()", "for name in before.keys()"),
        ("any(name in inputs or name.startswith", "all(name in inputs or name.startswith"),
        ("kinds = np.ndarray | int | float", "kinds = int | float"),
    ],
    "mujoco/identity.py": [
        ('        "names": zlib.crc32(official.names),\n', ""),
        (
            "kept[tuple(varying)] = _numbers(official, varying)",
            "kept[tuple(varying)] = _numbers(official, ())",
        ),
        ('.split(".")[:2]', '.split(".")'),
    ],
    "mujoco/index.py": [
        ("        return (..., *index, *(slice(None),) * rest)", "        return (..., *index)"),
        ("return (slice, key.start, key.stop, key.step)", "return (slice, key.start, key.stop)"),
        ("starts == -1, 0, 1)", "starts == -1, 1, 1)"),
    ],
    "mujoco/physics_state.py": [
        ("        np.copyto(item, part)\n", "        np.copyto(item, part[..., :1])\n"),
        ("    if state.shape != shape:", "    if state.size != np.prod(shape):"),
    ],
    "mujoco/wrapper/textures.py": [
        ("    sizes[is_textures] = 0\n", ""),
        ("return light if _is_like(light, model) else model", "return light"),
    ],
    "mujoco/compiled.py": [
        ("    _last_used.pop(source, None)\n", ""),
        ("in kept[:-1]:", "in kept:"),
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
    "mujoco/leaving.py": [
        ("    _is_leaving = True\n", ""),
        ("    _staying.add(threading.get_ident())\n", ""),
        ("    while _others_simulate() and", "    while False and"),
        ("        frame = frame.f_back\n", "        frame = None\n"),
        ('"limberjack.rl.", ', ""),
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
    "viewer/access.py": [
        (
            "if parsed is None or not self._names_this",
            "if parsed is not None and not self._names_this",
        ),
        (
            '        for origin in request.values("Origin"):\n',
            '        for origin in request.values("Origin")[:1]:\n',
        ),
        ("        if path == _UPLOADS:\n", "        if request.path == _UPLOADS:\n"),
        ("number.is_loopback or number == bound", "number.is_loopback or number.is_private"),
        ("bound is None or bound.is_unspecified", "bound is None"),
        ("and ports[0] == ports[1]", ""),
        ('_HOST.fullmatch(parts["host"])', '_HOST.match(parts["host"])'),
        ("parsed = _HOST.fullmatch(host.lower())", "parsed = _HOST.match(host.lower())"),
        ("return path == _PAGE and len(found) == 1 and", "return len(found) == 1 and"),
        ("if key.strip() == name", "if key == name"),
        ("port or self.address.port}", "self.address.port}"),
        ("if len(values) == 1 else", "if values else"),
        ("HttpOnly; SameSite=Strict", "SameSite=Lax"),
        ("number if mapped is None else mapped", "number"),
        ('request.method != "GET" or', ""),
    ],
    "viewer/guard.py": [
        ("            self._permitted.add(connection)\n", ""),
        (
            "            if connection not in self._permitted:\n                connection",
            "            if True:\n                connection",
        ),
        ("        asyncio.get_running_loop().call_later(_HANDSHAKE_LIMIT, expire)\n", ""),
        ('("Access-Control-Allow-Origin", *_HEADERS)', "_HEADERS"),
        ("        if connection not in self._permitted:\n            return\n", ""),
        (
            "        if response.status_code != _SWITCHING:\n            asyncio",
            "        if True:\n            asyncio",
        ),
        ('"max_size": _LONGEST_MESSAGE, ', ""),
        ("            self._started.set_exception(error)\n", ""),
    ],
    "viewer/address.py": [
        ("if self.is_fixed or error.errno", "if error.errno"),
        ("_free_port(number, _FIRST_PORT), is_fixed=False)", "_free_port(number, _FIRST_PORT))"),
        ("        made.listen()\n", "        pass\n"),
    ],
    "recording/episodes.py": [
        (
            "np.array_equal(recorded, found, equal_nan=True)",
            "np.allclose(recorded, found, rtol=0, atol=1e-9, equal_nan=True)",
        ),
        ("_observed_otherwise(recording, number + 1,", "_observed_otherwise(recording, number,"),
        ("if last == (step + 1 == recorded):", "if not last or step + 1 == recorded:"),
    ],
}
