"""The page of a comparison: figures, distributions and receivers side by side; it needs nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from gcs.playbook.schema import Playbook
from gcs.reports.chart import Level, Line, Panel, draw, spread
from gcs.reports.markup import Content, Html, element, table
from gcs.reports.page import page, section
from gcs.reports.tables import NONE
from gcs.simulate.comparison import Arm, comparison, formed_only
from gcs.simulate.outcome import ReceiverResult, RunResult
from gcs.simulate.paper_stop import EPSILON_SIGMAS

_LEAST_M: Final = 0.01
_PAPERS = f"""\
The paper's relay: L0 and the UAV in the slot before guide each receiver along its two lines of bearing, one receiver
after the other. Each leg is flown at constant speed and ends at the first sample whose angle is within
{EPSILON_SIGMAS:g} standard deviations of the stop angle (2 sqrt(2) sigma of a bearing) or beyond it; the paper's own
threshold of 1e-6 rad is met by no sampled, noisy bearing. Nothing is filtered, nobody slows down, and nobody is
verified or trimmed: who has flown its legs is taken to stand in its slot and guides the next. Who has run on beyond a
turning point so far that the next stop angle lies behind it stops there at once. Where the stop angle never comes the
receiver flies on at full speed until the leg has taken 30 s and three times as long as planned, or until another
vehicle is too near; then it is held, and the relay ends."""
_GIVEN = """\
What the paper leaves open is given to its relay as this one has it: where a receiver starts is located by many
bearings, its first leg is planned from there, it turns back onto a line that it has left by what the guide's raw
bearing says (where bearings are from north), and it stops when no bearing comes."""

Results = Mapping[str, Sequence[RunResult]]


def comparison_page(arms: Sequence[Arm], results: Results) -> Html:
    """Return the page; the first arm is the playbook's own."""
    playbook = arms[0].study.playbook
    told = comparison(arms, results)
    content = [
        element("header", element("h1", f"{playbook.name}: this relay and the paper's"), element("p", _same(playbook))),
        section("Figures", _figures(arms, told), note=_note(playbook)),
        section("What is compared", element("p", _ours(arms[0])), element("p", _PAPERS), element("p", _GIVEN)),
        section(
            "Distributions",
            element("p", [_marked(number, arm.title) for number, arm in enumerate(arms)], class_="legend"),
            element("div", _charts(arms, results), class_="cards"),
            note="How large each is (upwards) in how many of the cases (across): a flat line is always the same.",
        ),
        section(
            "Receivers",
            _receivers(arms, told),
            note="Placement error, m, median and 95 %, in the order in which the first relay brings them in.",
        ),
        section("What did not form", _reasons(arms, told)),
    ]
    return page(f"{playbook.name}: comparison", element("main", content))


def _same(playbook: Playbook) -> str:
    sensor, air = playbook.sensor, playbook.simulation
    return (
        f"The same seeds for all: bearings off by {sensor.sigma_deg:g}° (one standard deviation), "
        f"{sensor.rate_hz:g} a second, {sensor.latency_s:g} s late, {100 * sensor.drop_out:g} % of reports lost; "
        f"wind of {air.wind_mps:g} m/s, gusts of {air.gusts_mps:g} m/s."
    )


def _note(playbook: Playbook) -> str:
    return (
        f"In tolerance: every receiver is in truth within {playbook.flight.placement_tolerance_m:g} m of its slot. "
        "Errors are of receivers that count as placed; lengths, times and emission of runs that formed. "
        "Median, 95 %, largest."
    )


def _ours(arm: Arm) -> str:
    return (
        f"This relay: planned by the method {arm.study.plan.method}; each leg is followed by a filter over every "
        "bearing, slows down before its end, and ends where the receiver would come to rest within a band about it "
        "for a while; then the receiver is located in its slot, and brought back where bearings put it off."
    )


def _figures(arms: Sequence[Arm], told: Mapping[str, Any]) -> Html:
    def row(label: str, value: Callable[[Mapping[str, Any]], str]) -> list[Content]:
        return [label, *(value(told[arm.name]) for arm in arms)]

    def spread_of(label: str, key: str, digits: int) -> list[Content]:
        return row(label, lambda of_arm: _spread({**of_arm, **of_arm["of_formed"]}[key], digits))

    rows = [
        row("plan", lambda of_arm: str(of_arm["method"])),
        row("stop", lambda of_arm: str(of_arm["stop"])),
        row("speed, m/s", lambda of_arm: f"{of_arm['speed_mps']:g}"),
        row("says it formed", lambda of_arm: _share(of_arm["formed"], of_arm["runs"])),
        row("in tolerance", lambda of_arm: _share(of_arm["within_tolerance"], of_arm["runs"])),
        row("receivers placed", _placed),
        spread_of("placement error, m", "placement_error_m", 2),
        spread_of("its mean, hovering, m", "hover_error_m", 2),
        spread_of("stop error, m", "stop_error_m", 2),
        row("planned, m", lambda of_arm: f"{of_arm['planned_length_m']:.1f}"),
        spread_of("flown, m", "flown_length_m", 1),
        spread_of("duration, s", "duration_s", 0),
        spread_of("on the air, transmitter-seconds", "emission_transmitter_s", 0),
        row("closest approach, m", lambda of_arm: _number(of_arm["min_separation_m"], 1)),
    ]
    return table(["", *(element("span", arm.title) for arm in arms)], rows)


def _receivers(arms: Sequence[Arm], told: Mapping[str, Any]) -> Html:
    def cell(arm: Arm, name: str) -> str:
        of_one = told[arm.name]["by_receiver"].get(name)
        if of_one is None or not of_one["placed"]:
            return NONE
        error = of_one["placement_error_m"]
        return f"{error['p50']:.2f} · {error['p95']:.2f}"

    names = [route.receiver for route in arms[0].study.plan.routes]
    rows = [[element("b", name), *(cell(arm, name) for arm in arms)] for name in names]
    return table(["UAV", *(element("span", arm.title) for arm in arms)], rows)


def _reasons(arms: Sequence[Arm], told: Mapping[str, Any]) -> Html:
    rows = [
        [element("b", arm.title), str(count), reason]
        for arm in arms
        for reason, count in sorted(told[arm.name]["reasons"].items(), key=lambda found: -found[1])
    ]
    return table(["", "runs", "why"], rows) if rows else element("p", "every run formed")


def _charts(arms: Sequence[Arm], results: Results) -> list[Html]:
    def of_receivers(value: Callable[[ReceiverResult], float | None]) -> list[list[float]]:
        return [_sizes(value(one) for run in results[arm.name] for one in run.receivers) for arm in arms]

    def of_runs(value: Callable[[RunResult], float]) -> list[list[float]]:
        return [_sizes(value(run) for run in formed_only(results[arm.name])) for arm in arms]

    tolerance_m = arms[0].study.playbook.flight.placement_tolerance_m
    limit = Level(tolerance_m, "stop", f"tolerance: {tolerance_m:g} m")
    titles = [arm.title for arm in arms]
    drawn = [
        _chart("Placement error", "m", titles, of_receivers(lambda one: one.placement_error_m), limit),
        _chart("Stop error", "m", titles, of_receivers(lambda one: one.stop_error_m)),
        _chart("Flown, all receivers", "m", titles, of_runs(lambda run: run.flown_length_m), logarithmic=False),
        _chart("Duration", "s", titles, of_runs(lambda run: run.duration_s), logarithmic=False),
        _chart("On the air", "s", titles, of_runs(lambda run: run.emission_transmitter_s), logarithmic=False),
    ]
    return [chart for chart in drawn if chart is not None]


def _chart(
    title: str,
    unit: str,
    titles: Sequence[str],
    sizes: Sequence[Sequence[float]],
    level: Level | None = None,
    *,
    logarithmic: bool = True,
) -> Html | None:
    """Return how large a value is in which share of the cases, a line for each arm; None where there is no case."""
    every = [size for of_arm in sizes for size in of_arm]
    if not every:
        return None
    levels = () if level is None else (level,)
    shown = [*every, *(level.at for level in levels)]
    y = (max(_LEAST_M, min(shown)), max(*shown, 10 * _LEAST_M)) if logarithmic else (0.0, spread(shown)[1])
    lines = [
        Line(_steps(of_arm), f"line-{number}", name)
        for number, (name, of_arm) in enumerate(zip(titles, sizes, strict=True))
    ]
    panel = Panel((0.0, 100.0), y, "% of cases", unit, lines, levels, logarithmic=logarithmic)
    note = f"{unit}, logarithmic" if logarithmic else unit
    return element(
        "figure",
        element("figcaption", element("b", title), element("span", note, class_="note")),
        draw(panel, f"{title} by share of the cases"),
    )


def _steps(sizes: Sequence[float]) -> list[tuple[float, float | None]]:
    """Return the quantiles of sorted values, as a line of steps."""
    width = 100.0 / len(sizes) if sizes else 0.0
    return [((number + end) * width, size) for number, size in enumerate(sizes) for end in (0, 1)]


def _sizes(values: Any) -> list[float]:
    return sorted(abs(value) for value in values if value is not None)


def _marked(number: int, title: str) -> Content:
    return [element("i", class_=f"line-{number}"), element("span", title)]


def _placed(of_arm: Mapping[str, Any]) -> str:
    of_receivers = of_arm["by_receiver"].values()
    return _share(sum(one["placed"] for one in of_receivers), len(of_receivers) * of_arm["runs"])


def _share(count: int, of: int) -> str:
    return f"{count} of {of} ({100.0 * count / of:.0f} %)" if of else NONE


def _spread(values: Mapping[str, float | None], digits: int) -> str:
    if all(value is None for value in values.values()):
        return NONE
    return " · ".join(_number(value, digits) for value in values.values())


def _number(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{value:.{digits}f}"
