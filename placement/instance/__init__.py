"""What an instance file may say, and how one is read."""

from placement.instance.load import Instance, instance_from_dict, load_instance, shipped_instances
from placement.instance.messages import InstanceError
from placement.instance.schema import Document, PoseSelector

__all__ = [
    "Document",
    "Instance",
    "InstanceError",
    "PoseSelector",
    "instance_from_dict",
    "load_instance",
    "shipped_instances",
]
