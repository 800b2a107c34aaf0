"""What is wrong with a recording: frozen, miswired, too short, swinging by itself."""
