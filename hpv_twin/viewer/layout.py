"""The instrument panel: which views there are, where they stand and which part of time they show.

Left, single cycles around the time cursor; middle, the whole run, one strip per quantity over one
time axis, so that a setpoint's step stands right below what it changed; right, card and events.
"""
from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from hpv_twin.viewer import scene
from hpv_twin.viewer.scene import Curve, Panel

BEHIND, AHEAD = 0.02, 0.08  # s around the cursor: five cycles at 55 Hz
PLAYBACK_SPEED = 0.02  # one cycle of 55 Hz lasts about a second
HEADROOM = 0.08
LEGEND_ROOM = 0.25
MOST_STEPS = 4.6  # between numbers on the axis of a strip: closer ones the viewer omits


def build_blueprint(panels: list[Panel]) -> rrb.Blueprint:
    """Return the layout of all panels; each has a tab if there are several."""
    plots = [_plots(panel) for panel in panels]
    return rrb.Blueprint(
        rrb.Horizontal(plots[0] if len(plots) == 1 else rrb.Tabs(*plots), _notes(),
                       column_shares=[9, 3]),
        rrb.TimePanel(timeline=scene.TIME, playback_speed=PLAYBACK_SPEED, play_state='playing',
                      loop_mode='all', state='collapsed'),
        collapse_panels=True, auto_views=False)


def _plots(panel: Panel) -> rrb.Horizontal:
    """Return the cycles and the whole run of one machine."""
    views = [('pressure, gauge [MPa]', panel.pressures)] if panel.pressures else []
    for unit in dict.fromkeys(curve.quantity.unit for curve in panel.joints):
        views.append((f'position [{unit}]', [c for c in panel.joints if c.quantity.unit == unit]))
    cycles = [_cycle_view(f'Cycles, {name}', curves) for name, curves in views]
    whole = [_strip(f'Whole run, {views[0][0]}', panel.overview, _axis(panel.overview))]
    whole += [_strip(_capital(curve.quantity.title), [curve], _ticked_axis(curve))
              for curve in panel.numbers]
    return rrb.Horizontal(
        rrb.Vertical(*cycles, name='cycles'),
        rrb.Vertical(*whole, row_shares=[1.7] + [1] * len(panel.numbers), name='whole run'),
        column_shares=[5, 4], name=panel.name)


def _cycle_view(name: str, curves: list[Curve]) -> rrb.TimeSeriesView:
    """Return a view of the single cycles around the cursor."""
    return rrb.TimeSeriesView(
        name=name, contents=[curve.entity for curve in curves], axis_y=_axis(curves),
        plot_legend=_legend(curves), defaults=_defaults(),
        time_ranges=[_around_cursor(timeline) for timeline in (scene.TIME, scene.WALL_CLOCK)])


def _strip(name: str, curves: list[Curve], axis: rrb.ScalarAxis) -> rrb.TimeSeriesView:
    """Return a view of the whole run; its name tells from where to where the values go."""
    everything = rrb.TimeRange(start=rrb.TimeRangeBoundary.infinite(),
                               end=rrb.TimeRangeBoundary.infinite())
    return rrb.TimeSeriesView(
        name=f'{name}: {_extent(curves)}',
        contents=[curve.entity for curve in curves], axis_y=axis, plot_legend=_legend(curves),
        # Without a range, the viewer shows a minute around the cursor.
        defaults=_defaults(), axis_x=rrb.TimeAxis(view_range=everything))


def _extent(curves: list[Curve]) -> str:
    """Return the lowest and the highest value in words, as one if they look the same."""
    low, high = _limits(curves)
    digits = curves[0].quantity.digits
    ends = [f'{low:.{digits}f}', f'{high:.{digits}f}']
    return ' to '.join(dict.fromkeys(ends))


def _limits(curves: Iterable[Curve]) -> tuple[float, float]:
    """Return the lowest and the highest value, in the unit shown."""
    values = [curve.quantity.show(curve.signal.values) for curve in curves]
    values = np.concatenate([part[np.isfinite(part)] for part in values] or [np.empty(0)])
    return (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)


def _around_cursor(timeline: str) -> rrb.VisibleTimeRange:
    boundary = rrb.TimeRangeBoundary.cursor_relative
    return rrb.VisibleTimeRange(timeline, start=boundary(seconds=-BEHIND),
                                end=boundary(seconds=AHEAD))


def _defaults() -> list:
    """Return how a line is drawn that somebody adds to a view by hand."""
    return [rr.SeriesLines.from_fields(aggregation_policy=scene.MIN_MAX)]


def _legend(curves: list[Curve]) -> rrb.PlotLegend:
    """Return a legend in the room above the curves; a single curve is named by its view."""
    return rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=len(curves) > 1)


def _axis(curves: list[Curve]) -> rrb.ScalarAxis:
    """Return a fixed axis from zero, with room above for the legend where there is one."""
    low, high = _limits(curves)
    low, high = min(low, 0.0), max(high, 0.0)
    span = (high - low) or 1.0
    above = LEGEND_ROOM if len(curves) > 1 else HEADROOM
    return rrb.ScalarAxis(range=(low - HEADROOM * span, high + above * span))


def _ticked_axis(curve: Curve) -> rrb.ScalarAxis:
    """
    Return an axis for a low strip on which at least two numbers stand.

    The viewer labels powers of ten and what lies between them, if there is room; on an axis from
    zero to 55 a strip would have no number but 0.
    """
    low, high = _limits([curve])
    middle, span = (low + high) / 2.0, max(high - low, 0.1 * abs(high)) or 1.0
    step = 10.0 ** math.ceil(math.log10(span * (1.0 + 2.0 * HEADROOM) / MOST_STEPS))
    half = (0.5 + HEADROOM) * span
    if math.floor((middle + half) / step) - math.ceil((middle - half) / step) < 1:
        low, high = math.floor(low / step) * step, math.ceil(high / step) * step
        low, high = (low, high) if low < high else (low - step, high + step)
        middle, half = (low + high) / 2.0, (0.5 + HEADROOM) * (high - low)
    return rrb.ScalarAxis(range=(middle - half, middle + half))


def _notes() -> rrb.Vertical:
    """Return the card and the event log."""
    return rrb.Vertical(
        rrb.TextDocumentView(name='Recording', contents=[scene.CARD]),
        rrb.TextLogView(name='Events', contents=[scene.EVENTS], columns=rrb.TextLogColumns(
            text_log_columns=['LogLevel', 'Body'])), row_shares=[9, 2])


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
