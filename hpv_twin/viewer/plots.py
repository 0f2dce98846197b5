"""Plots over time: which part of it they show, and axes on which lines keep clear of legends."""
from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from hpv_twin.viewer import scene
from hpv_twin.viewer.scene import Curve


class Window(NamedTuple):
    """Which part of time plots show: around the cursor (s), and how much (s; None: all of it).

    Of a recording that still grows neither the end nor the highest value is known.
    """

    behind: float
    ahead: float
    long: float | None

    @property
    def is_live(self) -> bool:
        """Whether the recording still grows."""
        return self.long is not None

    def around_cursor(self) -> tuple:
        """Return the bounds of the single cycles."""
        boundary = rrb.TimeRangeBoundary.cursor_relative
        return boundary(seconds=-self.behind), boundary(seconds=self.ahead)


WHOLE = Window(0.02, 0.08, None)  # five cycles at 55 Hz
LIVE = Window(0.1, 0.0, 30.0)
HEADROOM = 0.08
LEGEND_ROOM = 0.3  # for each line of a legend but the first
MOST_STEPS = 4.6  # between numbers on the axis of a strip: closer ones the viewer omits


def cycle_view(name: str, curves: list[Curve], marks: list[Curve],
               window: Window) -> rrb.TimeSeriesView:
    """Return a view of the single cycles around the cursor, with marks on them."""
    in_title = marks and all(c.quantity.label.startswith('measured') for c in curves[1:])
    if in_title:  # a legend of so many would cover the curves
        name += ''.join(f', {curve.quantity.label.split(",")[0]} (grey)' for curve in curves[1:])
        name += '; dots: ' + ', '.join(mark.quantity.label for mark in marks)
    return rrb.TimeSeriesView(
        name=name, contents=[curve.entity for curve in curves + marks],
        axis_y=None if window.is_live else axis(curves[:1] if in_title else curves),
        plot_legend=_legend(curves, not in_title), defaults=_defaults(),
        time_ranges=[_between(timeline, *window.around_cursor())
                     for timeline in (scene.TIME, scene.WALL_CLOCK)])


def strip(name: str, curves: list[Curve], axis_y: rrb.ScalarAxis,
          window: Window) -> rrb.TimeSeriesView:
    """Return a view of the whole run; its name tells from where to where the values go."""
    contents = [curve.entity for curve in curves]
    boundary = rrb.TimeRangeBoundary
    if window.is_live:
        bounds = boundary.cursor_relative(seconds=-window.long), boundary.cursor_relative(seconds=0)
        return rrb.TimeSeriesView(
            name=name, contents=contents, plot_legend=_legend(curves), defaults=_defaults(),
            time_ranges=[_between(timeline, *bounds)
                         for timeline in (scene.TIME, scene.WALL_CLOCK)])
    everything = rrb.TimeRange(start=boundary.infinite(), end=boundary.infinite())
    return rrb.TimeSeriesView(
        name=f'{name}: {_extent(curves)}', contents=contents, axis_y=axis_y,
        plot_legend=_legend(curves), defaults=_defaults(),
        # Without a range, the viewer shows a minute around the cursor.
        axis_x=rrb.TimeAxis(view_range=everything))


def _extent(curves: list[Curve]) -> str:
    """Return the lowest and the highest value in words, as one if they look the same."""
    low, high = limits(curves)
    digits = curves[0].quantity.digits
    ends = [f'{low:.{digits}f}', f'{high:.{digits}f}']
    return ' to '.join(dict.fromkeys(ends))


def limits(curves: Iterable[Curve]) -> tuple[float, float]:
    """Return the lowest and the highest value, in the unit shown."""
    values = [curve.quantity.show(curve.signal.values) for curve in curves]
    values = np.concatenate([part[np.isfinite(part)] for part in values] or [np.empty(0)])
    return (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)


def _between(timeline: str, start, end) -> rrb.VisibleTimeRange:
    return rrb.VisibleTimeRange(timeline, start=start, end=end)


def _defaults() -> list:
    """Return how a line is drawn that somebody adds to a view by hand."""
    return [rr.SeriesLines.from_fields(aggregation_policy=scene.MIN_MAX)]


def _legend(curves: list[Curve], wanted: bool = True) -> rrb.PlotLegend:
    """Return a legend in the room above the curves; a single curve is named by its view."""
    return rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=wanted and len(curves) > 1)


def axis(curves: list[Curve]) -> rrb.ScalarAxis:
    """Return a fixed axis from zero, with room above for the legend where there is one."""
    low, high = limits(curves)
    low, high = min(low, 0.0), max(high, 0.0)
    span = (high - low) or 1.0
    above = LEGEND_ROOM * (len(curves) - 1) if len(curves) > 1 else HEADROOM
    return rrb.ScalarAxis(range=(low - HEADROOM * span, high + above * span))


def ticked_axis(curve: Curve) -> rrb.ScalarAxis:
    """
    Return an axis for a low strip on which at least two numbers stand.

    The viewer labels powers of ten and what lies between them, if there is room; on an axis from
    zero to 55 a strip would have no number but 0.
    """
    low, high = limits([curve])
    middle, span = (low + high) / 2.0, max(high - low, 0.1 * abs(high)) or 1.0
    step = 10.0 ** math.ceil(math.log10(span * (1.0 + 2.0 * HEADROOM) / MOST_STEPS))
    half = (0.5 + HEADROOM) * span
    if math.floor((middle + half) / step) - math.ceil((middle - half) / step) < 1:
        low, high = math.floor(low / step) * step, math.ceil(high / step) * step
        low, high = (low, high) if low < high else (low - step, high + step)
        middle, half = (low + high) / 2.0, (0.5 + HEADROOM) * (high - low)
    return rrb.ScalarAxis(range=(middle - half, middle + half))
