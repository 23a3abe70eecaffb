"""`delta-cal`: a file a verb."""
