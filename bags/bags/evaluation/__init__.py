"""What a drive was worth; shares nothing with what drove it."""
