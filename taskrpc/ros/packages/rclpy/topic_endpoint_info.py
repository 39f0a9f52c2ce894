"""The old name of `endpoint_info`."""

from .endpoint_info import EndpointTypeEnum as TopicEndpointTypeEnum
from .endpoint_info import TopicEndpointInfo

__all__ = ["TopicEndpointInfo", "TopicEndpointTypeEnum"]
