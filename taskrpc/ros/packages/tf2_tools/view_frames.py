"""Draws the tree of frames: `taskrpc run tf2_tools view_frames`."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from tf2_msgs.srv import FrameGraph
from tf2_ros import Buffer, TransformListener
from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC


def generate_dot(data: Mapping[str, Mapping[str, Any]], recorded_time: tuple[int, int]) -> str:
    """A graph of the frames, for graphviz.

    Args:
        data: the frames, as in the YAML of the service `tf2_frames`.
        recorded_time: the present time, in seconds and nanoseconds.
    """
    if not data:
        return 'digraph G { "No tf data received" }'
    lines = ["digraph G {"]
    for name, frame in data.items():
        label = (
            f"Broadcaster: {frame['broadcaster']}\\n"
            f"Average rate: {frame['rate']}\\n"
            f"Buffer length: {frame['buffer_length']}\\n"
            f"Most recent transform: {frame['most_recent_transform']}\\n"
            f"Oldest transform: {frame['oldest_transform']}\\n"
        )
        lines.append(f'"{frame["parent"]}" -> "{name}"[label=" {label}"];')
    roots = [frame["parent"] for frame in data.values() if frame["parent"] not in data]
    seconds = recorded_time[0] + recorded_time[1] / 1e9
    lines += [
        "edge [style=invis];",
        ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";',
        f'"Recorded at time: {seconds}"[ shape=plaintext ] ;',
        f'}}->"{roots[-1]}";' if roots else "}",  # frames in a loop have no root
    ]
    return "\n".join(lines) + "\n}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="view_frames",
        description="Create a diagram of the TF frames being broadcast over ROS",
    )
    parser.add_argument(
        "--wait-time",
        "-t",
        type=float,
        default=5.0,
        help="Listen to the /tf topic for this many seconds before rendering the frame tree",
    )
    parser.add_argument("-o", "--output", help="Output filename")
    parser.add_argument("--tf_topic", default=DEFAULT_TF_TOPIC, help="Topic for dynamic transforms")
    parser.add_argument(
        "--tf_static_topic", default=DEFAULT_STATIC_TF_TOPIC, help="Topic for static transforms"
    )
    return parser


def _view(node: Node, arguments: argparse.Namespace) -> None:
    logger = node.get_logger()
    buffer = Buffer(node=node)
    listener = TransformListener(
        buffer, node, tf_topic=arguments.tf_topic, tf_static_topic=arguments.tf_static_topic
    )
    logger.info(f"Listening to tf data for {arguments.wait_time} seconds...")
    end = time.monotonic() + arguments.wait_time
    while (left := end - time.monotonic()) > 0:
        rclpy.spin_once(node, timeout_sec=min(0.1, left))
    listener.unregister()
    logger.info("Generating graph...")
    result = FrameGraph.Response(frame_yaml=buffer.all_frames_as_yaml())
    logger.info(f"Result:{result}")
    name = arguments.output or f"frames_{time.strftime('%Y-%m-%d_%H.%M.%S')}"
    graph, pdf = Path(f"{name}.gv"), f"{name}.pdf"
    logger.info(f"Exporting graph in {pdf} file...")
    now = node.get_clock().now().seconds_nanoseconds()
    graph.write_text(generate_dot(yaml.safe_load(result.frame_yaml), now), encoding="utf-8")
    try:
        subprocess.run(["dot", "-Tpdf", str(graph), "-o", pdf], check=True)
    except FileNotFoundError:
        logger.warning(
            f"{pdf} was not written, because graphviz (the command dot) is not installed;"
            f" the graph is in {graph}"
        )
    except subprocess.CalledProcessError as error:
        logger.error(f"{pdf} was not written: dot ended with {error.returncode}")
        sys.exit(1)


def main(args: list[str] | None = None) -> None:
    """Listen for 5 seconds, then write the graph."""
    arguments = _parser().parse_args(remove_ros_args(sys.argv if args is None else args)[1:])
    try:
        with rclpy.init(args=args):
            _view(Node("view_frames"), arguments)
    except KeyboardInterrupt:
        pass
