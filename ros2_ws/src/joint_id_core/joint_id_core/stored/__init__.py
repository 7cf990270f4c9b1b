"""What is known of the joints, kept beyond the end of a run and of the process."""
