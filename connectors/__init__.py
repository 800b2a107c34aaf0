"""Where recordings come from: one connector per kind of source, all behind one protocol."""
