"""The asynchronous shells round the pure parts."""
