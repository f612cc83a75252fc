"""What others' programs need for the same work, in the same run on the same input."""
