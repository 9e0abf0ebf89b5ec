"""What it looks like where two recordings of scripts differ: how far bodies are from golden's."""

from __future__ import annotations

import numpy as np
import polars as pl

from pipeline.analysis.script.difference import Difference
from pipeline.analysis.script.sample_differences import Faced
from pipeline.seen import Body

STATES_ARE_THE_SAME = "every state is the same all the same"


def looks_like(of: Faced, state: Difference | None) -> str:
    """Say in a sentence how far apart bodies are.

    Parameters
    ----------
    of
        The samples of both.
    state
        The first state that differs; None where none does.
    """
    if state is None:
        return STATES_ARE_THE_SAME
    if state.column == "there":
        has, lacks = ("it", "golden") if state.value else ("golden", "it")
        return f"{has} has {state.body} at step {state.step}, {lacks} has not"
    (body,) = (one for one in of.bodies.values() if one.label == state.body)
    rows = of.rows.with_columns(distance_m=pl.Series(of.distance_m)).with_columns(
        pl.col("distance_m").fill_nan(None)
    )
    its = rows.filter(pl.col("body") == body.number, pl.col("link") == state.link)
    at_m = its.filter(pl.col("step") == state.step)["distance_m"][0]
    last_step, last_m = its.select("step", "distance_m").row(-1)
    name = _name(body, state.link)
    if at_m:
        said = f"{name} is {_mm(at_m)} elsewhere at step {state.step}"
    else:
        said = f"{name} moves in another way from step {state.step} on"
    if last_m is not None and last_step > state.step:
        there = f"{_mm(last_m)} elsewhere" if last_m else "in the same place"
        said += f", {there} at the end (step {last_step})"
    number, link, step, most_m = rows.select("body", "link", "step", "distance_m").row(
        int(np.argmax(rows["distance_m"].fill_null(-1.0)))
    )
    if most_m is not None and _mm(most_m) not in said and most_m > max(at_m or 0.0, last_m or 0.0):
        said += f", {_mm(most_m)} at most ({_name(of.bodies[number], link)}, step {step})"
    return said


def _name(body: Body, link: int | None) -> str:
    if link is None or link < 0:
        return body.label
    return f"{body.label}'s link {link} ({body.links[link + 1]})"


def _mm(length_m: float) -> str:
    return f"{length_m * 1e3:.3g} mm"
