"""All targets, and the readers that have none, with the reason."""

import dataclasses

from benchmarks.fuzz.binary_targets import BINARY_TARGETS
from benchmarks.fuzz.config_targets import CONFIG_TARGETS
from benchmarks.fuzz.once_crashed import ONCE_CRASHED
from benchmarks.fuzz.recording_targets import RECORDING_TARGETS
from benchmarks.fuzz.target import Target
from benchmarks.fuzz.text_targets import TEXT_TARGETS

TARGETS: dict[str, Target] = {
    target.name: dataclasses.replace(target, once_crashed=ONCE_CRASHED.get(target.name, {}))
    for target in (*TEXT_TARGETS, *CONFIG_TARGETS, *BINARY_TARGETS, *RECORDING_TARGETS)
}

_CHOOSES = "chooses one of the readers that are targets"
_PART = "a part of readers that are targets, which hand it the file or what stands in it"
_FOLDER = "lists a folder; what reads its files and tables are targets"
_STATE = "reads back what jaxgeo itself wrote, and makes it anew where it cannot"
_NO_CONTENT = "looks at names, paths or whole bytes only, or writes"


def _because(reason: str, package: str, *names: str) -> dict[str, str]:
    return {f"{package}.{name}": reason for name in names}


# Dotted name -> why it is no target of its own.
EXCEPTIONS: dict[str, str] = {
    **_because(
        *(_CHOOSES, "jaxgeo.io"),
        *("frames.source.open_frames", "frames.source.kind_of", "rgbd.source.open_rgbd", "rgbd.source.rgbd_kind_of"),
        *("scans.source.open_scans", "scans.source.scan_kind_of"),
    ),
    **_because(
        *(_PART, "jaxgeo.io"),
        *(
            "bag_reader.topics_of_types",
            "checks.unit_quaternions",
            "checks.validated_trajectory",
            "json_file.read_json",
        ),
        *("clouds.las_head.las_problem", "frames.image_message.image_of_message", "frames.stamps.number_of"),
        *("frames.image_size.claimed_size", "frames.image_size.missing_bytes"),
        *("frames.image_message.image_of_compressed_message", "g2o_poses.is_whole_number", "g2o_poses.pose_vertices"),
        *("item_stamps.is_stamp_list", "named_file.is_there", "rgbd.depth.depth_of_compressed_message"),
        *("rgbd.depth.depth_of_message", "rgbd.rgbd_source.frame_of_images", "scans.point_cloud2.columns_of_message"),
        *("sighting_covariance.camera_to_body", "text_file.read_lines", "text_table.read_table"),
        *("regular_file.head_of", "regular_file.read_whole", "text_table.table_of_rows"),
    ),
    **_because(
        *(_PART, "jaxgeo.io.rtabmap"),
        *("blobs.numbers", "connection.open_read_only", "connection.refusals", "graph.best_poses", "graph.graph_of"),
        *("graph.odometry_by_session", "graph.trajectory_of", "image_blob.image_size", "image_blob.image_suffix"),
        *("links.read_links", "nodes.read_nodes", "nodes.with_optimised", "rvl.decode_rvl"),
    ),
    **_because(
        *(_PART, "jaxgeo"),
        *("mapping.carried_after._heading", "mapping.carried_after._read_grid", "cli.campaign_sessions._of_list"),
        *("cli.campaign_sessions._may_be_a_session", "config.load._set"),
    ),
    **_because(
        *(_FOLDER, "jaxgeo.io"),
        *("frames.folder.FolderFrames", "rgbd.folder.FolderRgbd", "rgbd.layout.rgbd_files", "scans.folder.FolderScans"),
        "item_stamps.stamped_files",
    ),
    **_because(
        *(_STATE, "jaxgeo"),
        *("cli.campaign_rows.attempts_begun", "cli.campaign_rows.read_row", "cli.campaign_task._evaluated"),
        *("cli.compare._is_simulated", "cli.computed._account", "cli.detection_record.DetectionRecord"),
        *("export.run_file.leftovers", "cli.campaign_noise_file.keep_or_write"),
    ),
    **_because(_STATE, "eval.montecarlo.chunks", "_read", "_read_settings"),
    "eval.montecarlo.chunks.write_chunk": _NO_CONTENT,
    **_because(
        *(_NO_CONTENT, "jaxgeo"),
        *(
            "io.atomic.atomic_path",
            "io.atomic.output_folder",
            "io.clouds.chunk.warn_left_out",
            "io.item_source.is_bag_folder",
        ),
        *("io.clouds.writer.cloud_writer", "io.frames.stamps.stamp_in_name", "cli.campaign_pool._value_label"),
        *("cli.campaign_sessions._session", "cli.detection_job.settings_values", "cli.ingest.file_hashes"),
        *("cli.input_identity.code_hash", "cli.machine._processor", "cli.warp._sha256", "precision.let_programs_go"),
        *("export.interactive.interactive_scripts", "mapping.kornia_features.DiskFeatures"),
    ),
}
