"""What rates, mixed forms and memory bring, frame after frame of whole drives."""
