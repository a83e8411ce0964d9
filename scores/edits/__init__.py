"""What each verb that changes the music does to the texts of a score."""
