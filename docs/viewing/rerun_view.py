"""Opens a recording in Rerun with a layout: the room with floor, ceiling and airframe, the three views, and the events.

usage: rerun_view.py RECORDING [--save FILE.rrd]
needs: pip install rerun-sdk mcap-protobuf-support
"""

import argparse

import rerun as rr
import rerun.blueprint as rrb
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def layout():
    """Where what is shown. Series are paths into the protobuf messages, which Rerun finds by reflection."""
    views = [rrb.Spatial2DView(origin=f"/camera/{name}", name=name) for name in ("full", "red", "depth")]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(
                    origin="/",
                    name="room",
                    contents=["/plant/pose", "/tracker/pose", "/tf", "/tf_static", "/camera/**", "/room/**"],
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


def log_scene(recording):
    """Draws what Rerun's own reader passes over, the message of the kind foxglove.SceneUpdate: each entity in its frame, its parts upright."""
    with open(recording, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        entities = [entity for *_, scene in reader.iter_decoded_messages(topics=["/scene"]) for entity in scene.entities]
    for entity in entities:
        for shape, parts in (("cubes", entity.cubes), ("cylinders", entity.cylinders)):
            if not parts:
                continue
            sizes = [[part.size.x, part.size.y, part.size.z] for part in parts]
            common = {
                "centers": [[part.pose.position.x, part.pose.position.y, part.pose.position.z] for part in parts],
                "colors": [[part.color.r, part.color.g, part.color.b, part.color.a] for part in parts],
                "fill_mode": "solid",
            }
            if shape == "cubes":
                drawn = rr.Boxes3D(sizes=sizes, **common)
            else:
                drawn = rr.Cylinders3D(lengths=[z for _, _, z in sizes], radii=[0.5 * x for x, _, _ in sizes], **common)
            rr.log(f"/room/{entity.id}/{shape}", rr.CoordinateFrame(entity.frame_id), drawn, static=True)


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
    log_scene(arguments.recording)
    rr.log_file_from_path(arguments.recording)


if __name__ == "__main__":
    main()
