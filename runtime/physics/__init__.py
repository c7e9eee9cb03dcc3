"""The law of friction and the pan, in every form that plans and streams need."""
