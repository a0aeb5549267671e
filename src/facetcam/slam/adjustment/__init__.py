"""Bundle adjustment, and how well the images determine what it yields."""
