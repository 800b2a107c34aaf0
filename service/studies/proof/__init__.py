"""The blind proof: hidden physics is drawn, sealed, judged from CSV files alone, and counted."""
