"""Findings for code review, as GitHub Actions annotations and as SARIF.

Both formats are for machines, and so always in English.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from drop_physics.drop.findings import ALL_RULES
from drop_physics.rules.answer import Finding
from drop_physics.rules.codes import Level
from drop_physics.rules.reference import reference_of

if TYPE_CHECKING:
    from drop_physics.analysis.results import Analysis

SEVERITY: dict[Level, tuple[str, str]] = {
    "broken": ("error", "error"),
    "asked": ("warning", "warning"),
    "model": ("warning", "warning"),
    "repeat": ("notice", "note"),
    "note": ("notice", "note"),
}
"""Severity of each level, in GitHub's workflow commands and in SARIF."""
SCHEMA = (
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
)


def github_of(analysis: Analysis) -> str:
    """Return the findings as GitHub Actions workflow commands, one per line.

    The format is documented in GitHub's "Workflow commands for GitHub Actions".
    """
    return "".join(f"{_command(finding, analysis)}\n" for finding in analysis.findings)


def _command(finding: Finding, analysis: Analysis) -> str:
    file, line = _place(finding, analysis)
    values = {"file": file, "line": line, "title": f"drop: {finding.code}"}
    given = {name: str(value) for name, value in values.items() if value is not None}
    properties = ",".join(
        f"{name}={_escaped(value).replace(':', '%3A').replace(',', '%2C')}"
        for name, value in given.items()
    )
    return f"::{SEVERITY[finding.level][0]} {properties}::{_escaped(_text(finding))}"


def _escaped(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _text(finding: Finding) -> str:
    return "\n".join(map(str, filter(None, (finding.told, finding.advised))))


def _place(finding: Finding, analysis: Analysis) -> tuple[str | None, int | None]:
    """Return the file and line of a finding; the script if the finding names no line."""
    name, _, line = (finding.site or "").rpartition(":")
    file = name or str((analysis.origin or {}).get("script") or "")
    if file in analysis.sources:
        file = str(_from_here(analysis.sources[file]))
    return file or None, int(line) if line.isdecimal() else None


def _from_here(path: Path) -> Path:
    here = Path.cwd()
    whole = path.resolve()
    return whole.relative_to(here) if whole.is_relative_to(here) else path


def sarif_of(analysis: Analysis) -> str:
    """Return the findings as a SARIF 2.1.0 log, which code scanning services read."""
    codes = [*dict.fromkeys(finding.code for finding in analysis.findings)]
    driver = {
        "name": "drop",
        "version": metadata.version("drop-physics"),
        "rules": [*map(_rule, codes)],
    }
    run = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "results": [*_results(analysis.findings, analysis, codes)],
    }
    log = {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2, ensure_ascii=False) + "\n"


def _rule(code: str) -> dict[str, Any]:
    """Return the SARIF rule for a finding's code, with its meaning."""
    told = reference_of(code, ALL_RULES)
    cures = [*told.advises, *(f"to try: {each}" for each in told.proposes)]
    rule: dict[str, Any] = {"id": code, "shortDescription": {"text": str(told.meaning)}}
    if told.measured:
        rule["fullDescription"] = {"text": " ".join(map(str, told.measured))}
    if cures:
        rule["help"] = {"text": "\n".join(cures)}
    if told.level is not None:
        rule["defaultConfiguration"] = {"level": SEVERITY[told.level][1]}
    return rule


def _results(
    findings: Sequence[Finding], analysis: Analysis, codes: Sequence[str]
) -> Iterator[dict[str, Any]]:
    for finding in findings:
        file, line = _place(finding, analysis)
        about = ("level", "reason", "body", "joint", "share")
        parts = (finding.code, finding.reason, finding.body, finding.joint, file)
        result = {
            "ruleId": finding.code,
            "ruleIndex": codes.index(finding.code),
            "level": SEVERITY[finding.level][1],
            "message": {"text": _text(finding)},
            # By what it is about: a finding is the same where its line has moved.
            "partialFingerprints": {"finding/v1": ":".join(part or "" for part in parts)},
            "properties": {name: getattr(finding, name) for name in about},
        }
        if file is not None:
            region = {} if line is None else {"region": {"startLine": line}}
            artifact = {"artifactLocation": {"uri": quote(file)}}
            result["locations"] = [{"physicalLocation": artifact | region}]
        yield result


FORMATS: dict[str, Callable[[Analysis], str]] = {"github": github_of, "sarif": sarif_of}
"""Function that writes each output format."""
