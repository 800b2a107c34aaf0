"""OPC UA servers with a history, read only (HistoryReadRaw). Needs the extra ``opcua``.

``OpcUaArchive`` is the connector, ``OpcUaAddress`` how it travels; tags are node ids.
"""

from stemwatch.connectors.opcua.connector import OpcUaAddress, OpcUaArchive
from stemwatch.connectors.opcua.session import Security

__all__ = ["OpcUaAddress", "OpcUaArchive", "Security"]
