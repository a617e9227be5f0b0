"""The demo: head and reconstruction as processes, a bag, a comparison with the truth, pictures, a report."""
