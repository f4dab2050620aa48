"""Point clouds and poses as others store them: files in, plain arrays out."""
