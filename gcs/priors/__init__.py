"""What is known of an aircraft before it flies: another program's derivatives, or its sizes, as a model with doubts."""
