"""Opens a recording in Rerun with a layout: the room, the three views, altitude, throttle and events.

usage: rerun_view.py RECORDING [--save FILE.rrd]
needs: pip install rerun-sdk
"""

import argparse

import rerun as rr
import rerun.blueprint as rrb


def layout():
    """Where what is shown. Series are paths into the protobuf messages, which Rerun finds by reflection."""
    views = [rrb.Spatial2DView(origin=f"/camera/{name}", name=name) for name in ("full", "red", "depth")]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(
                    origin="/",
                    name="room",
                    contents=["/plant/pose", "/tracker/pose", "/tf", "/tf_static", "/camera/**"],
                    spatial_information=rrb.SpatialInformation(target_frame="world"),
                ),
                rrb.TextLogView(origin="/bench/event", name="events"),
                row_shares=[4, 1],
            ),
            rrb.Vertical(*views),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("--save", metavar="FILE.rrd", help="write recording and layout here and open nothing")
    arguments = parser.parse_args()
    rr.init("bench", spawn=False)
    if arguments.save:
        rr.save(arguments.save, default_blueprint=layout())
    else:
        rr.spawn(default_blueprint=layout())
    rr.log_file_from_path(arguments.recording)


if __name__ == "__main__":
    main()
