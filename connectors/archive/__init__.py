"""What connectors to archives share: numbers with times and quality codes, to one recording.

A Parquet folder, an OPC UA server and a database all deliver numbers rather than text; from there
on the same rules hold for them as for the text exports of a historian.
"""
