from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Encoding(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ENCODING_UNSPECIFIED: _ClassVar[Encoding]
    ENCODING_RAW: _ClassVar[Encoding]
    ENCODING_PNG: _ClassVar[Encoding]

class Command(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    COMMAND_UNSPECIFIED: _ClassVar[Command]
    COMMAND_STRAIGHT: _ClassVar[Command]
    COMMAND_LEFT: _ClassVar[Command]
    COMMAND_RIGHT: _ClassVar[Command]
ENCODING_UNSPECIFIED: Encoding
ENCODING_RAW: Encoding
ENCODING_PNG: Encoding
COMMAND_UNSPECIFIED: Command
COMMAND_STRAIGHT: Command
COMMAND_LEFT: Command
COMMAND_RIGHT: Command

class Pose(_message.Message):
    __slots__ = ("x_m", "y_m", "heading_rad")
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    HEADING_RAD_FIELD_NUMBER: _ClassVar[int]
    x_m: float
    y_m: float
    heading_rad: float
    def __init__(self, x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., heading_rad: _Optional[float] = ...) -> None: ...

class Calibration(_message.Message):
    __slots__ = ("camera", "width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "rig_from_camera_qx", "rig_from_camera_qy", "rig_from_camera_qz", "rig_from_camera_qw", "position_in_rig_x_m", "position_in_rig_y_m", "position_in_rig_z_m")
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    FX_PX_FIELD_NUMBER: _ClassVar[int]
    FY_PX_FIELD_NUMBER: _ClassVar[int]
    CX_PX_FIELD_NUMBER: _ClassVar[int]
    CY_PX_FIELD_NUMBER: _ClassVar[int]
    K1_FIELD_NUMBER: _ClassVar[int]
    K2_FIELD_NUMBER: _ClassVar[int]
    RIG_FROM_CAMERA_QX_FIELD_NUMBER: _ClassVar[int]
    RIG_FROM_CAMERA_QY_FIELD_NUMBER: _ClassVar[int]
    RIG_FROM_CAMERA_QZ_FIELD_NUMBER: _ClassVar[int]
    RIG_FROM_CAMERA_QW_FIELD_NUMBER: _ClassVar[int]
    POSITION_IN_RIG_X_M_FIELD_NUMBER: _ClassVar[int]
    POSITION_IN_RIG_Y_M_FIELD_NUMBER: _ClassVar[int]
    POSITION_IN_RIG_Z_M_FIELD_NUMBER: _ClassVar[int]
    camera: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    k1: float
    k2: float
    rig_from_camera_qx: float
    rig_from_camera_qy: float
    rig_from_camera_qz: float
    rig_from_camera_qw: float
    position_in_rig_x_m: float
    position_in_rig_y_m: float
    position_in_rig_z_m: float
    def __init__(self, camera: _Optional[str] = ..., width_px: _Optional[int] = ..., height_px: _Optional[int] = ..., fx_px: _Optional[float] = ..., fy_px: _Optional[float] = ..., cx_px: _Optional[float] = ..., cy_px: _Optional[float] = ..., k1: _Optional[float] = ..., k2: _Optional[float] = ..., rig_from_camera_qx: _Optional[float] = ..., rig_from_camera_qy: _Optional[float] = ..., rig_from_camera_qz: _Optional[float] = ..., rig_from_camera_qw: _Optional[float] = ..., position_in_rig_x_m: _Optional[float] = ..., position_in_rig_y_m: _Optional[float] = ..., position_in_rig_z_m: _Optional[float] = ...) -> None: ...

class Image(_message.Message):
    __slots__ = ("time_ns", "width_px", "height_px", "encoding", "data")
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    time_ns: int
    width_px: int
    height_px: int
    encoding: Encoding
    data: bytes
    def __init__(self, time_ns: _Optional[int] = ..., width_px: _Optional[int] = ..., height_px: _Optional[int] = ..., encoding: _Optional[_Union[Encoding, str]] = ..., data: _Optional[bytes] = ...) -> None: ...

class CameraView(_message.Message):
    __slots__ = ("calibration", "images")
    CALIBRATION_FIELD_NUMBER: _ClassVar[int]
    IMAGES_FIELD_NUMBER: _ClassVar[int]
    calibration: Calibration
    images: _containers.RepeatedCompositeFieldContainer[Image]
    def __init__(self, calibration: _Optional[_Union[Calibration, _Mapping]] = ..., images: _Optional[_Iterable[_Union[Image, _Mapping]]] = ...) -> None: ...

class Ego(_message.Message):
    __slots__ = ("time_ns", "pose", "velocity_x_mps", "velocity_y_mps", "yaw_rate_radps", "acceleration_x_mps2", "acceleration_y_mps2", "steering_rad")
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_X_MPS_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_Y_MPS_FIELD_NUMBER: _ClassVar[int]
    YAW_RATE_RADPS_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_X_MPS2_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_Y_MPS2_FIELD_NUMBER: _ClassVar[int]
    STEERING_RAD_FIELD_NUMBER: _ClassVar[int]
    time_ns: int
    pose: Pose
    velocity_x_mps: float
    velocity_y_mps: float
    yaw_rate_radps: float
    acceleration_x_mps2: float
    acceleration_y_mps2: float
    steering_rad: float
    def __init__(self, time_ns: _Optional[int] = ..., pose: _Optional[_Union[Pose, _Mapping]] = ..., velocity_x_mps: _Optional[float] = ..., velocity_y_mps: _Optional[float] = ..., yaw_rate_radps: _Optional[float] = ..., acceleration_x_mps2: _Optional[float] = ..., acceleration_y_mps2: _Optional[float] = ..., steering_rad: _Optional[float] = ...) -> None: ...

class SessionHello(_message.Message):
    __slots__ = ("version", "cameras", "history", "horizon_ns", "step_ns", "deadline_millis")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    HISTORY_FIELD_NUMBER: _ClassVar[int]
    HORIZON_NS_FIELD_NUMBER: _ClassVar[int]
    STEP_NS_FIELD_NUMBER: _ClassVar[int]
    DEADLINE_MILLIS_FIELD_NUMBER: _ClassVar[int]
    version: int
    cameras: _containers.RepeatedCompositeFieldContainer[Calibration]
    history: int
    horizon_ns: int
    step_ns: int
    deadline_millis: int
    def __init__(self, version: _Optional[int] = ..., cameras: _Optional[_Iterable[_Union[Calibration, _Mapping]]] = ..., history: _Optional[int] = ..., horizon_ns: _Optional[int] = ..., step_ns: _Optional[int] = ..., deadline_millis: _Optional[int] = ...) -> None: ...

class PolicyHello(_message.Message):
    __slots__ = ("version", "name")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    version: int
    name: str
    def __init__(self, version: _Optional[int] = ..., name: _Optional[str] = ...) -> None: ...

class Observation(_message.Message):
    __slots__ = ("sequence", "time_ns", "cameras", "ego", "command", "horizon_ns", "step_ns", "deadline_millis")
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    EGO_FIELD_NUMBER: _ClassVar[int]
    COMMAND_FIELD_NUMBER: _ClassVar[int]
    HORIZON_NS_FIELD_NUMBER: _ClassVar[int]
    STEP_NS_FIELD_NUMBER: _ClassVar[int]
    DEADLINE_MILLIS_FIELD_NUMBER: _ClassVar[int]
    sequence: int
    time_ns: int
    cameras: _containers.RepeatedCompositeFieldContainer[CameraView]
    ego: _containers.RepeatedCompositeFieldContainer[Ego]
    command: Command
    horizon_ns: int
    step_ns: int
    deadline_millis: int
    def __init__(self, sequence: _Optional[int] = ..., time_ns: _Optional[int] = ..., cameras: _Optional[_Iterable[_Union[CameraView, _Mapping]]] = ..., ego: _Optional[_Iterable[_Union[Ego, _Mapping]]] = ..., command: _Optional[_Union[Command, str]] = ..., horizon_ns: _Optional[int] = ..., step_ns: _Optional[int] = ..., deadline_millis: _Optional[int] = ...) -> None: ...

class PlanPose(_message.Message):
    __slots__ = ("after_ns", "pose")
    AFTER_NS_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    after_ns: int
    pose: Pose
    def __init__(self, after_ns: _Optional[int] = ..., pose: _Optional[_Union[Pose, _Mapping]] = ...) -> None: ...

class PlanProposal(_message.Message):
    __slots__ = ("poses", "score")
    POSES_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    poses: _containers.RepeatedCompositeFieldContainer[PlanPose]
    score: float
    def __init__(self, poses: _Optional[_Iterable[_Union[PlanPose, _Mapping]]] = ..., score: _Optional[float] = ...) -> None: ...

class PlanContext(_message.Message):
    __slots__ = ("channels", "values")
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    channels: int
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, channels: _Optional[int] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...

class PolicyPlan(_message.Message):
    __slots__ = ("for_sequence", "poses", "proposals", "context")
    FOR_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    PROPOSALS_FIELD_NUMBER: _ClassVar[int]
    CONTEXT_FIELD_NUMBER: _ClassVar[int]
    for_sequence: int
    poses: _containers.RepeatedCompositeFieldContainer[PlanPose]
    proposals: _containers.RepeatedCompositeFieldContainer[PlanProposal]
    context: PlanContext
    def __init__(self, for_sequence: _Optional[int] = ..., poses: _Optional[_Iterable[_Union[PlanPose, _Mapping]]] = ..., proposals: _Optional[_Iterable[_Union[PlanProposal, _Mapping]]] = ..., context: _Optional[_Union[PlanContext, _Mapping]] = ...) -> None: ...

class SessionGoodbye(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class PolicyGoodbye(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...
