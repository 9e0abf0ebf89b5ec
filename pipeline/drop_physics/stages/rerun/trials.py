"""The trials of `drop why` beside a recording: their verdicts belong to its findings."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drop_physics.recording.layer_file import VERDICTS, trials_of
from drop_physics.rules.answer import Finding

MOST_BYTES = 1 << 24
"""Largest size of a file of verdicts; a longer one is not ours."""


PROVEN = "cured", "part"
"""Verdicts of trials that prove a finding."""


class Trials:
    """The verdicts of trials on the findings of a recording, if they are of this one.

    Parameters
    ----------
    recording, recording_id
        The recording, and its id.
    """

    def __init__(self, recording: Path, recording_id: str) -> None:
        self._by_message: dict[str, Mapping[str, Any]] = {}
        with contextlib.suppress(OSError, ValueError, RecursionError, KeyError, TypeError):
            with (trials_of(recording) / VERDICTS).open("rb") as file:
                held = json.loads(file.read(MOST_BYTES))
            if held["recording_id"] == recording_id:
                self._by_message = {
                    each["message"]: each
                    for each in held["findings"]
                    if isinstance(each["verdict"], str) and all(map(_is_trial, each["tried"]))
                }

    def with_verdict(self, finding: Finding) -> Finding:
        """Return a finding with the verdicts of its trials."""
        shown = self._by_message.get(str(finding.message))
        if shown is None:
            return finding
        proof = "trial" if shown["verdict"] in PROVEN else finding.proof
        return replace(finding, proof=proof, verdict=shown["verdict"], tried=tuple(shown["tried"]))


def _is_trial(value: object) -> bool:
    """Return whether a value of the file is a trial, as far as its keys are used."""
    return isinstance(value, dict) and all(
        isinstance(value.get(name), str) for name in ("name", "call", "verdict")
    )
