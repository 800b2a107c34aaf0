"""From the bytes of an export to a table of text cells: encoding, rows, header, shape."""
