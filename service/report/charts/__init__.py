"""The data of a valve's plots: a typical part of the record, thinned traces, charts."""
