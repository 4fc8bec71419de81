"""The messages of ABB's Externally Guided Motion as classes of Protocol Buffers, built when they are imported.

Names, numbers and types are those of the egm.proto that comes with RobotWare; what this package neither reads nor writes is
left out, which Protocol Buffers permit. Enumerations are given as their numbers.
"""

from __future__ import annotations

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

__all__ = ["EgmRobot", "EgmSensor"]

PACKAGE = "abb.egm"
_FIELD = descriptor_pb2.FieldDescriptorProto
_SCALARS = {
    "double": _FIELD.TYPE_DOUBLE,
    "uint64": _FIELD.TYPE_UINT64,
    "uint32": _FIELD.TYPE_UINT32,
    "bool": _FIELD.TYPE_BOOL,
    "enum": _FIELD.TYPE_INT32,  # the same on the wire
}
_LABELS = {
    "optional": _FIELD.LABEL_OPTIONAL,
    "required": _FIELD.LABEL_REQUIRED,
    "repeated": _FIELD.LABEL_REPEATED,
}

MESSAGES = {
    "EgmHeader": ["optional uint32 seqno = 1", "optional uint32 tm = 2", "optional enum mtype = 3"],
    "EgmCartesian": ["required double x = 1", "required double y = 2", "required double z = 3"],
    "EgmQuaternion": [
        "required double u0 = 1",
        "required double u1 = 2",
        "required double u2 = 3",
        "required double u3 = 4",
    ],
    "EgmClock": ["required uint64 sec = 1", "required uint64 usec = 2"],
    "EgmPose": ["optional EgmCartesian pos = 1", "optional EgmQuaternion orient = 2"],
    "EgmJoints": ["repeated double joints = 1"],
    "EgmPlanned": [
        "optional EgmJoints joints = 1",
        "optional EgmPose cartesian = 2",
        "optional EgmJoints externalJoints = 3",
        "optional EgmClock time = 4",
    ],
    "EgmFeedBack": [
        "optional EgmJoints joints = 1",
        "optional EgmPose cartesian = 2",
        "optional EgmJoints externalJoints = 3",
        "optional EgmClock time = 4",
    ],
    "EgmMotorState": ["required enum state = 1"],  # 1 on, 2 off
    "EgmMCIState": ["required enum state = 1"],  # 1 error, 2 stopped, 3 running
    "EgmRapidCtrlExecState": ["required enum state = 1"],  # 1 stopped, 2 running
    "EgmRobot": [
        "optional EgmHeader header = 1",
        "optional EgmFeedBack feedBack = 2",
        "optional EgmPlanned planned = 3",
        "optional EgmMotorState motorState = 4",
        "optional EgmMCIState mciState = 5",
        "optional bool mciConvergenceMet = 6",
        "optional EgmRapidCtrlExecState rapidExecState = 8",
        "optional double utilizationRate = 10",
    ],
    "EgmSensor": ["optional EgmHeader header = 1", "optional EgmPlanned planned = 2"],
}


def _file() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(name="bt_jax/egm.proto", package=PACKAGE, syntax="proto2")
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        for words in map(str.split, fields):
            label, kind, field, _, number = words
            added = message.field.add(name=field, number=int(number), label=_LABELS[label])
            if kind in _SCALARS:
                added.type = _SCALARS[kind]
            else:
                added.type, added.type_name = _FIELD.TYPE_MESSAGE, f".{PACKAGE}.{kind}"
    return file


_pool = descriptor_pool.DescriptorPool()  # of our own: another package may have the same names in the default one
_pool.AddSerializedFile(_file().SerializeToString())
EgmRobot = message_factory.GetMessageClass(_pool.FindMessageTypeByName(f"{PACKAGE}.EgmRobot"))
EgmSensor = message_factory.GetMessageClass(_pool.FindMessageTypeByName(f"{PACKAGE}.EgmSensor"))
