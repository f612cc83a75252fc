"""What `import coadapt` offers to scripts and notebooks."""
