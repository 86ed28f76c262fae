"""A job of a camera on an arm: its simulation, the job and the camera's file."""

SIMULATION = """\
arm: {urdf: arm.urdf, tip: tip}
seed: 3
errors: [{select: ["joint_[2-5].offset"], std_deg: 0.5}, {select: [joint_4.z], std_mm: 1}]
noise: {corner_px: 0.2}
sets:
  calibration: &set
    kind: camera_view
    board: board.yaml
    camera: camera.yaml
    samples: 16
    camera_pose: {position_mm: [20, -30, 40], rotation_rpy_deg: [5, 10, 90]}
    board_pose: {position_mm: [450, 100, -100], rotation_rpy_deg: [180, 0, 20]}
  validation: *set
"""
ROW = (
    "{{kind: camera_view, corners: corners/{0}.csv, board: board.yaml, camera: camera.yaml, "
    "samples: '{0}/*.csv', huber_px: 1}}"
)
JOB = f"""\
arm: {{urdf: arm.urdf, tip: tip}}
parameters:
  - {{select: ["joint_[2-5].offset"], bound_deg: 5}}
  - {{select: [joint_4.z], bound_mm: 30}}
observations: [{ROW.format("calibration")}]
validation: [{ROW.format("validation")}]
"""
CAMERA = """\
image_width: 1280
image_height: 960
camera_matrix: {rows: 3, cols: 3, data: [1000, 0, 639.5, 0, 1002, 479.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0.0005, -0.0003, 0]}
"""
