"""The robot agent: senses, describes its scene, and answers queries for observations."""
