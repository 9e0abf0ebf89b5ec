"""Finds why a script stopped with an error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from drop_physics.messages import Message
from drop_physics.rules.answer import so_many
from drop_physics.rules.arguments import given, site_of
from drop_physics.rules.engines import ANY
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rows import Case, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import BODY_NAMES, Call
from drop_physics.trace.events import Body
from drop_physics.trace.log import Log

NO_JOINT = "Joint index out-of-range."
"""PyBullet's error message for a missing joint, which it also gives for a missing body."""
INDICES = ("jointIndex", "jointIndices", "linkIndex", "linkIndices")
"""Arguments that contain a joint index, or a link index."""
NOT_CONNECTED = "Not connected to physics server."


@input_rule("script-failed", "broken", engines=ANY)
def script_failed(inputs: Inputs, origin: Mapping[str, Any]) -> Iterator[Case]:
    """The script ended with an error, possibly raised by a call."""
    if found := failure(origin, *inputs.raised):
        message, site = found
        yield Case(values={"says": message}, site=site)


script_failed.rows(SayingRow())


def failure(
    origin: Mapping[str, Any], raised: Call | None, calls: Log, *, printed: str = ""
) -> tuple[Message, str | None] | None:
    """Return the error that ended a script, with its line; None if it did not fail.

    Parameters
    ----------
    origin
        Properties of the script, and of the end of its run.
    raised
        The last call that raised an exception, which the script may have handled.
    calls
        The calls around that one.
    printed
        The beginning of the error message, if that is already displayed elsewhere; it is then left
        out.
    """
    error = origin.get("error")
    if origin.get("ended") != "failed" or not error:
        return None
    # The type is written without its module in the one, and with it in the other.
    said, site = error.partition(": ")[2], origin.get("error_site")
    rest = error.removeprefix(printed).strip()
    message = Message("the script fails")
    if origin.get("kind") == "imported":
        message = Message("the states do not stay finite")
    if raised is not None and said and said.startswith(raised.raised.partition(": ")[2]):
        site = site_of(raised)
        message = Message(
            "the script fails after {steps} in p.{function}({arguments}){why}",
            steps=so_many(raised.at.step),
            function=raised.function,
            arguments=raised.arguments,
            why=_why(raised, calls),
        )
    elif said == NOT_CONNECTED:
        why = Message(
            "There is no simulation with that number: p.connect did not make it, or p.disconnect "
            "ended it"
        )
        rest = Message("{error} {why}", error=rest, why=why) if rest else why
    if rest:
        message = Message("{what}: {error}", what=message, error=rest)
    return message, site


def _why(call: Call, calls: Log) -> str:
    """Explain an error of PyBullet, as far as the failed call shows the reason."""
    if call.act is Act.LOAD and call.arguments.startswith(("'", "fileName='")):
        return Message(", a file that it cannot find or read")
    numbers = next((n for name in BODY_NAMES if (n := given(call, name))), ())
    if not numbers:
        return ""
    came = calls.body_at(call, int(numbers[0]))
    if came is None:
        return Message(", and there is no body {number}", number=int(numbers[0]))
    asked = [index for name in INDICES for index in given(call, name)]
    beyond = max(asked, default=-1) >= len(came.body.joints)
    return _joints_of(came.body) if beyond or call.raised.endswith(NO_JOINT) else ""


def _joints_of(body: Body) -> Message:
    if not body.joints:
        return Message(", and {body} has no joints", body=body.label)
    last = len(body.joints) - 1
    return Message(", and {body} has the joints 0 to {last}", body=body.label, last=last)
