"""Random and damaged inputs for whatever the programs read: files, options, settings, folders of earlier runs."""
