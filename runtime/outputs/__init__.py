"""What a plan comes out as, for other programs and for people: one file a format. Each is made of a plan's document."""
