"""AVEVA (OSIsoft) PI through the PI Web API, read only.

``PiArchive`` is the connector, ``PiAddress`` how it travels. Recorded values are asked for, never
interpolated ones or those of a plot, and nothing but GET is ever sent.
"""

from stemwatch.connectors.pi.connector import PiAddress, PiArchive

__all__ = ["PiAddress", "PiArchive"]
