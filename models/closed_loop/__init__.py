"""The control loop around a valve, fitted to its recording, and simulated with changes."""
