"""Work in processes of its own: estimations and uploads, which must not make reception wait."""
