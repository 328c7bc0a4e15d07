"""The numbers printed in the paper's tables 2 to 6, as they stand there, printed errors included.

Lengths are in the paper's units, taken as metres; places are polar (m, degrees) as printed. Tables 3, 4 and 6 are about
L0 with the axis towards L1; table 2 is about its target point with the axis from A.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

Polar = tuple[float, float]


class Legs(NamedTuple):
    """One cell of table 6: the length of a route, and in parentheses those of its two legs."""

    total: float
    first: float
    second: float


@dataclass(frozen=True)
class PositioningCase:
    """One row of table 2: where the receiver is ("position"), and where the paper's model puts it."""

    name: str
    position: Polar
    estimate: Polar
    error_radius: float


@dataclass(frozen=True)
class Positioning:
    """Table 2 and the setting of section 3.2: B lies on the axis, C and the target O at these places about A."""

    b: float
    c: Polar
    target: Polar
    cases: tuple[PositioningCase, ...]


@dataclass(frozen=True)
class Lengths:
    """One row of table 3 or 4; `misprint_for` is what the two-step length has to read where it is a misprint."""

    receiver: str
    start: Polar
    slot: Polar
    geometric: float
    two_step: float
    misprint_for: float | None = None


@dataclass(frozen=True)
class LengthTable:
    """Table 3 or 4."""

    rows: tuple[Lengths, ...]
    geometric_total: float
    two_step_total: float


@dataclass(frozen=True)
class ModelLengths:
    """One row of table 6."""

    receiver: str
    model_1: Legs
    model_2: Legs
    two_step: Legs


@dataclass(frozen=True)
class ModelTable:
    """Table 6."""

    rows: tuple[ModelLengths, ...]
    model_1_total: float
    model_2_total: float
    two_step_total: float


@dataclass(frozen=True)
class Strategy:
    """One column of table 5."""

    total: float
    complexity: str
    optimization: str


@dataclass(frozen=True)
class PrintedPaper:
    """Tables 2 to 6; table 5 as its columns geometric optimization and two-step strategy."""

    table_2: Positioning
    table_3: LengthTable
    table_4: LengthTable
    table_5: tuple[Strategy, Strategy]
    table_6: ModelTable


PRINTED = PrintedPaper(
    table_2=Positioning(
        b=9.55,
        c=(6.13, 71.64),
        target=(5.30, 30.91),
        cases=(
            PositioningCase("Inside", (1.77, 135.26), (1.7690, 135.1851), 0.0025),
            PositioningCase("Left", (6.62, 132.61), (6.6181, 132.5999), 0.0022),
            PositioningCase("Right", (8.38, 16.66), (8.3792, 16.6902), 0.0045),
            PositioningCase("Down", (5.51, -132.28), (5.5065, -132.2874), 0.0036),
            PositioningCase("Top left", (6.72, 89.59), (6.7238, 89.5719), 0.0044),
            PositioningCase("Bottom left", (8.49, -174.11), (8.4842, -174.1090), 0.0058),
            PositioningCase("Bottom right", (9.05, -61.30), (9.0446, -61.2753), 0.0067),
        ),
    ),
    table_3=LengthTable(
        rows=(
            Lengths("U1", (75.58, 4.66), (100.00, 40.00), 261.64, 81.84),
            Lengths("U2", (64.99, 45.21), (100.00, 80.00), 33.26, 91.21),
            Lengths("U3", (40.36, 103.13), (100.00, 120.00), 139.06, 82.81),
            Lengths("U4", (112.35, 195.95), (100.00, 160.00), 51.66, 82.67),
            Lengths("U5", (125.84, 209.70), (100.00, 200.00), 33.93, 36.52),
            Lengths("U6", (97.02, 257.83), (100.00, 240.00), 125.17, 45.34, misprint_for=42.74),
            Lengths("U7", (84.11, 288.20), (100.00, 280.00), 22.24, 29.84),
            Lengths("U8", (70.59, 331.74), (100.00, 320.00), 86.51, 43.95),
        ),
        geometric_total=753.47,
        two_step_total=491.58,
    ),
    table_4=LengthTable(
        rows=(
            Lengths("U1", (63.22, 356.41), (100.00, 17.14), 339.04, 74.15),
            Lengths("U2", (63.40, 50.45), (100.00, 34.29), 44.02, 48.03),
            Lengths("U3", (106.70, 47.58), (100.00, 51.43), 57.84, 14.22),
            Lengths("U4", (76.07, 61.12), (100.00, 68.57), 94.72, 35.80),
            Lengths("U5", (91.13, 77.02), (100.00, 85.71), 87.34, 22.87),
            Lengths("U6", (81.75, 87.07), (100.00, 102.86), 133.09, 45.34),
            Lengths("U7", (55.46, 130.98), (100.00, 120.00), 60.17, 49.85),
            Lengths("U8", (142.39, 134.34), (100.00, 137.14), 98.16, 47.91),
            Lengths("U9", (89.99, 146.39), (100.00, 154.29), 89.34, 22.63),
            Lengths("U10", (81.91, 173.37), (100.00, 171.43), 79.98, 19.97),
            Lengths("U11", (142.84, 194.59), (100.00, 188.57), 103.18, 48.06),
            Lengths("U12", (149.85, 217.47), (100.00, 205.71), 88.83, 60.79),
            Lengths("U13", (91.18, 217.10), (100.00, 222.86), 113.51, 17.86),
            Lengths("U14", (138.36, 225.17), (100.00, 240.00), 92.12, 64.63),
            Lengths("U15", (139.80, 250.65), (100.00, 257.14), 101.81, 52.17),
            Lengths("U16", (136.23, 270.87), (100.00, 274.29), 84.28, 42.92),
            Lengths("U17", (100.84, 305.10), (100.00, 291.43), 19.68, 26.96),
            Lengths("U18", (147.51, 336.24), (100.00, 308.57), 93.32, 78.87),
            Lengths("U19", (75.07, 344.66), (100.00, 325.71), 42.40, 44.67),
            Lengths("U20", (103.08, 349.62), (100.00, 342.86), 36.36, 12.68),
        ),
        geometric_total=1859.19,
        two_step_total=830.38,
    ),
    table_5=(Strategy(753.47, "O(k·n)", "Gradient descent"), Strategy(491.58, "O(n)", "Equation (24)")),
    table_6=ModelTable(
        rows=(
            ModelLengths("U1", Legs(81.84, 21.86, 59.98), Legs(124.19, 54.05, 70.14), Legs(81.84, 21.86, 59.98)),
            ModelLengths("U2", Legs(91.21, 32.20, 59.01), Legs(127.07, 48.77, 78.30), Legs(91.21, 32.20, 59.01)),
            ModelLengths("U3", Legs(82.81, 53.75, 29.06), Legs(84.29, 14.45, 69.84), Legs(82.81, 53.75, 29.06)),
            ModelLengths("U4", Legs(160.33, 55.48, 104.85), Legs(82.67, 66.36, 16.31), Legs(82.67, 66.36, 16.31)),
            ModelLengths("U5", Legs(37.06, 17.66, 19.40), Legs(36.52, 24.25, 12.27), Legs(36.52, 24.25, 12.27)),
            ModelLengths("U6", Legs(60.72, 21.95, 38.77), Legs(42.74, 30.12, 12.62), Legs(42.74, 30.12, 12.62)),
            ModelLengths("U7", Legs(38.70, 22.52, 16.18), Legs(29.84, 12.04, 17.80), Legs(29.84, 12.04, 17.80)),
            ModelLengths("U8", Legs(63.83, 39.90, 23.93), Legs(43.95, 14.43, 29.52), Legs(43.95, 14.43, 29.52)),
        ),
        model_1_total=616.50,
        model_2_total=571.27,
        two_step_total=491.58,
    ),
)
