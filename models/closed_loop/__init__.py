"""The control loop around a valve, fitted to its recording, and run again as it might be."""
