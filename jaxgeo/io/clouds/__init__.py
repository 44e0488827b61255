"""Point clouds in files, in chunks: LAS and LAZ, PLY."""
