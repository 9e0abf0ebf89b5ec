"""How results look: what of a script's result stands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from drop_physics.console.output import print_json, print_lines
from drop_physics.messages import Message

if TYPE_CHECKING:
    from drop_physics.stages.trust import Trust, Varied


def show_trust(trust: Trust, *, as_json: bool, within_m: float | None) -> int:
    """Print what stands, and return the exit code: 3 if a variation ends farther apart."""
    if as_json:
        print_json(
            {
                "script": trust.script,
                "recording": str(trust.recording),
                "variations": [
                    {
                        "name": each.name,
                        "recording": str(each.recording),
                        "ended": each.ended,
                        "most": [asdict(one) for one in each.apart.most],
                        "end": [asdict(one) for one in each.apart.end],
                        "from_s": each.apart.from_s,
                    }
                    for each in trust.variations
                ],
                "growth": trust.growth and asdict(trust.growth),
                "converging": trust.converging and asdict(trust.converging),
            }
        )
    else:
        print_lines(*trust_lines(trust))
    ends = [one.value for each in trust.variations for one in each.apart.end if one.unit == "m"]
    return 3 if within_m is not None and not all(value <= within_m for value in ends) else 0


def trust_lines(trust: Trust) -> list[str]:
    """Return what the terminal prints."""
    lines = [Message("{script}: how far apart its variations end", script=trust.script), ""]
    for each in trust.variations:
        lines += _lines_of(each)
    grown, found = trust.growth, trust.converging
    if grown is not None:
        lines.append(
            Message("a displacement of 1e-9 grows e-fold in {time:.3g} s",
                time=1 / grown.rate_per_s)
        )  # fmt: skip
        if grown.lost_s is not None:
            lines.append(
                Message("beyond {time:.3g} s the outcome is one of many", time=grown.lost_s)
            )
    if found is not None:
        part = f"{found.body} {found.joint or 'xyz'[found.component]}"
        lines.append(
            Message("{part} does not converge with the timestep", part=part)
            if found.order is None
            else Message(
                "{part} converges with the timestep, order {order:.2f}, to {value:.6g} ± {off:.1g}",
                part=part, order=found.order, value=found.extrapolated, off=found.uncertainty,
            )
        )  # fmt: skip
    return lines


def _lines_of(varied: Varied) -> Iterator[str]:
    ends = [
        f"{one.value:.3g} {one.unit} ({one.body}{' ' + one.joint if one.joint else ''})"
        for one in varied.apart.end
        if one.value
    ]
    if not ends:
        yield f"{varied.name:14}0"
    else:
        from_s = varied.apart.from_s
        since = "" if from_s is None else Message(", from {time:.4g} s on", time=from_s)
        yield f"{varied.name:14}{', '.join(ends)}{since}"
