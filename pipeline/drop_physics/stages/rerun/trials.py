"""Reads what `drop why` stored for a recording: which changes fixed which findings."""

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
"""Largest file of verdicts that is read [bytes]; `drop` writes no larger one."""


PROVEN = "cured", "part"
"""Verdicts that count as proof of a finding."""


class Trials:
    """What trial runs showed about a recording's findings, if it has any.

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
        """Return a finding with the results of its trial runs added."""
        shown = self._by_message.get(str(finding.message))
        if shown is None:
            return finding
        proof = "trial" if shown["verdict"] in PROVEN else finding.proof
        return replace(finding, proof=proof, verdict=shown["verdict"], tried=tuple(shown["tried"]))


def _is_trial(value: object) -> bool:
    """Return whether a JSON value has the fields of a stored trial."""
    return isinstance(value, dict) and all(
        isinstance(value.get(name), str) for name in ("name", "call", "verdict")
    )
