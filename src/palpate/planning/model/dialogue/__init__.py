"""What is said to a model and by it: rounds of feedback, a second reader, the record."""
