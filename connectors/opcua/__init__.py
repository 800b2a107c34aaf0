"""OPC UA servers with a history, read only (HistoryReadRaw). Needs the extra ``opcua``.

``OpcUaArchive`` is the connector, ``OpcUaAddress`` how it travels; tags are node ids.
"""

from stemwatch.connectors.opcua.address import OpcUaAddress, Security
from stemwatch.connectors.opcua.connector import OpcUaArchive

__all__ = ["OpcUaAddress", "OpcUaArchive", "Security"]
