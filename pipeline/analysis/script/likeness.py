"""How a difference between two recordings of scripts looks: how far bodies are from golden's."""

from __future__ import annotations

import numpy as np
import polars as pl

from pipeline.analysis.script.difference import Difference
from pipeline.analysis.script.sample_differences import Paired
from pipeline.fields import decimals
from pipeline.messages import Message, joined
from pipeline.seen import Body

STATES_ARE_THE_SAME = Message("every state that both have is identical")


def looks_like(of: Paired, state: Difference | None) -> Message:
    """Say in a sentence how far apart bodies are.

    Parameters
    ----------
    of
        The samples of both.
    state
        The first state that differs; None where none does.
    """
    if state is None:
        return STATES_ARE_THE_SAME if len(of.rows) else Message("no body that moves is in both")
    at = {"body": state.body, "step": state.step}
    if state.column == "there":
        if state.value:
            return Message("it has {body} at step {step}, golden does not", **at)
        return Message("golden has {body} at step {step}, it does not", **at)
    (body,) = (body for body in of.bodies.values() if body.label == state.body)
    rows = of.rows.with_columns(distance_m=pl.Series(of.distance_m)).with_columns(
        pl.col("distance_m").fill_nan(None)
    )
    its = rows.filter(pl.col("body") == body.number, pl.col("link") == state.link)
    at_m = its.filter(pl.col("step") == state.step)["distance_m"][0]
    last_step, last_m = its.select("step", "distance_m").row(-1)
    at["body"] = _name(body, state.link)
    clauses = [Message("{body} moves differently from step {step} on", **at)]
    if at_m:
        clauses = [Message("{body} is {distance} off at step {step}", distance=_mm(at_m), **at)]
    shown = [_mm(at_m)] if at_m else []
    if last_m is not None and last_step > state.step:
        clauses.append(Message("in the same place at the end (step {step})", step=last_step))
        if last_m:
            shown.append(_mm(last_m))
            clauses[-1] = Message(
                "{distance} off at the end (step {step})", distance=_mm(last_m), step=last_step
            )
    number, link, step, most_m = rows.select("body", "link", "step", "distance_m").row(
        int(np.argmax(rows["distance_m"].fill_null(-1.0)))
    )
    if most_m is not None and _mm(most_m) not in shown and most_m > max(at_m or 0.0, last_m or 0.0):
        clauses.append(
            Message(
                "{distance} at most ({body}, step {step})",
                distance=_mm(most_m),
                body=_name(of.bodies[number], link),
                step=step,
            )
        )
    return joined(", ", clauses)


def _name(body: Body, link: int | None) -> str:
    if link is None or link < 0:
        return body.label
    return Message(
        "{body}'s link {link} ({name})", body=body.label, link=link, name=body.links[link + 1]
    )


def _mm(length_m: float) -> str:
    length_mm = length_m * 1e3
    return f"{length_mm:.3g} mm" if length_mm < 100 else f"{decimals(length_mm, 0)} mm"
