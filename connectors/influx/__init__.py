"""InfluxDB 2 and 3 through InfluxQL at ``/query``, read only: nothing but GET is ever sent."""

from stemwatch.connectors.influx.connector import InfluxAddress, InfluxArchive

__all__ = ["InfluxAddress", "InfluxArchive"]
