"""What travels: systems and designs as FMUs, and the certificate that a file carries."""
