"""What the plots of a valve draw: a typical part of the record, thinned traces, charts."""
