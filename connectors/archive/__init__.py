"""Shared by connectors to archives: numbers with times and quality codes become one recording.

Parquet files, OPC UA servers and databases deliver numbers instead of text; apart from that, the
rules are those of a historian's text exports.
"""
