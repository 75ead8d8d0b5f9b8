"""The plain values that `examine` returns."""

import dataclasses
import json

import pytest

from limberjack.doctor.findings import Backend, Check, Extra, Threads


def test_an_extra_is_installed_if_nothing_is_missing() -> None:
    assert Extra("video", (), "pip install").is_installed
    assert not Extra("video", ("matplotlib",), "pip install").is_installed


@pytest.mark.parametrize(
    "found",
    [
        Check(works=False, why="it crashed"),
        Backend("egl", works=True, renderer="llvmpipe"),
        Threads("humanoid", "stand", 64, {1: 100.0}, recommended=None, why="no cores"),
        Extra("video", ("matplotlib",), "pip install"),
    ],
)
def test_findings_become_json(found: Check | Backend | Threads | Extra) -> None:
    text = json.dumps(dataclasses.asdict(found))
    assert set(json.loads(text)) == {field.name for field in dataclasses.fields(found)}
