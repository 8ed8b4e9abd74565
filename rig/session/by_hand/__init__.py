"""What a person does at the bench, one thing at a time: the commands share it with the process behind the panel."""
