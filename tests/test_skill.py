"""The page for coding assistants: each command works, and prints the JSON keys that it names."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from generators.pages import blocks, commands
from generators.typed import run_command

PAGE = Path(__file__).parents[1] / "skills/drop/SKILL.md"
TEXT = PAGE.read_text(encoding="utf-8")
SCRIPT = """
import mujoco
model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
 <geom name="table" type="plane" size="1 1 0.1"/>
 <body name="cube" pos="0 0 0.11"><freejoint/><geom name="cube" size="0.05"/></body>
</worldbody></mujoco>''')
data = mujoco.MjData(model)
for _ in range(25):
    mujoco.mj_step(model, data)
"""


def test_the_page_is_one_page_with_a_head() -> None:
    assert re.match(r"---\nname: drop\ndescription: [^\n]{50,1024}\n---\n\n# ", TEXT)
    assert len(TEXT.split()) < 600


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the output of each command on the page, run literally, one after the other."""
    folder = tmp_path_factory.mktemp("skill")
    (folder / "sim.py").write_text(SCRIPT)
    (folder / "before.py").write_text(SCRIPT.replace("0.11", "0.12"))
    typed = [one for block in blocks(TEXT) if block.kind == "sh" for one in commands(block.text)]
    done = {command: run_command(command, folder) for command in typed}
    assert {command: code for command, (code, _) in done.items() if code} == {}
    return {command: text for command, (_, text) in done.items()}


def object_of(printed: dict[str, str], begins: str) -> dict[str, Any]:
    """Return the JSON object in a command's output, ignoring text before and after it."""
    (text,) = (text for command, text in printed.items() if command.startswith(begins))
    return dict(json.loads(text[text.index("{") : text.rindex("}") + 1]))


@pytest.mark.long
@pytest.mark.pybullet  # a page is run as users have it
def test_each_command_of_the_page_works_and_answers(printed: dict[str, str]) -> None:
    assert len(printed) == 5
    (_, meaning, whole, why, diff) = printed.values()
    told = object_of(printed, "drop --json")
    assert told["script"] == "sim.py"
    assert len(json.dumps(told)) < 2_500
    assert meaning.startswith("code        off-target")
    assert '"bodies"' in whole
    found = object_of(printed, "drop why")
    assert found["expectation"]["text"] == "z('cube') > 0.1"
    assert not found["expectation"]["holds"]
    assert found["makes_true"]
    assert why.endswith("it does not hold: exit code 3\n")
    assert object_of(printed, "drop diff")["because"][0]["element"] == "cube"
    assert diff.endswith("apart: exit code 3\n")


NAMED = {
    "account", "advice", "because", "breaks", "call", "complete", "explained", "findings", "least",
    "makes_true", "message", "moves", "no_effect", "not_said", "proof", "site", "terms", "verdict",
}  # fmt: skip
"""Keys that the page mentions."""


def test_the_keys_that_the_page_names_exist() -> None:
    schemas = PAGE.parents[2] / "docs/schemas"
    texts = [(schemas / f"{name}.json").read_text() for name in ("script", "why", "diff")]
    assert {name for name in NAMED if f'"{name}": {{' not in "".join(texts)} == set()
    assert {name for name in NAMED if f"`{name}`" not in TEXT} == set()
